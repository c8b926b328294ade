"""The documented result of localization, ``avssl-result/1``, in degrees."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource

FORMAT = "avssl-result/1"


def _degrees(angle: float) -> float:
    return round(float(np.rad2deg(angle)), 2)


def result_dict(
    posterior: ClipPosterior,
    sources: tuple[LocalizedSource, ...],
    grid: DirectionGrid,
    separated: Sequence[Path] | None = None,
    **context: Any,
) -> dict[str, Any]:
    """One clip's result as JSON values.

    Args:
        posterior, sources, grid: what was found.
        separated: the file with the sound of each source, if there are such files.
        context: further fields, such as the names of the files.
    """
    return {
        "format": FORMAT,
        **context,
        "sources": [
            {
                "azimuth_deg": _degrees(source.azimuth),
                "azimuth_std_deg": _degrees(source.azimuth_std),
                "level": round(source.level, 4),
                "level_std": round(source.level_std, 4),
                "source_class": source.source_class,
            }
            | ({} if separated is None else {"separated": str(separated[s])})
            for s, source in enumerate(sources)
        ],
        "mixing_levels": [round(float(level), 6) for level in posterior.mixing_levels_k],
        "direction_weights": [[round(float(w), 6) for w in weights_d] for weights_d in posterior.direction_weights_kd],
        "directions_deg": [_degrees(azimuth) for azimuth in grid.azimuths],
    }

"""The result of localizing one clip, and its documented form ``avssl-result/1``."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource

FORMAT = "avssl-result/1"


def _degrees(angle: float) -> float:
    return round(float(np.rad2deg(angle)), 2)


@dataclass(frozen=True)
class Localization:
    """The posterior of one clip and the sources selected from it.

    Args:
        posterior: posterior means and spreads.
        sources: sources, loudest first.
        grid: directions of the posterior's weights.
    """

    posterior: ClipPosterior = field(repr=False)
    sources: tuple[LocalizedSource, ...]
    grid: DirectionGrid

    def to_dict(self, separated: Sequence[Path] | None = None, **context: Any) -> dict[str, Any]:
        """JSON values of the result, ``avssl-result/1``, angles in degrees.

        Args:
            separated: files with the sound of each source, in order.
            context: further fields, such as the names of the files.
        """
        posterior = self.posterior
        return {
            "format": FORMAT,
            **context,
            "sources": [
                {
                    "azimuth_deg": _degrees(source.azimuth),
                    "azimuth_std_deg": _degrees(source.azimuth_std),
                    "level": round(source.level, 4),
                    "level_std": round(source.level_std, 4),
                    "direct_level": round(source.direct_level, 4),
                    "source_class": source.source_class,
                }
                | ({} if separated is None else {"separated": str(separated[s])})
                for s, source in enumerate(self.sources)
            ],
            "mixing_levels": [round(float(level), 6) for level in posterior.mixing_levels_k],
            "direction_weights": [
                [round(float(weight), 6) for weight in weights_d] for weights_d in posterior.direction_weights_kd
            ],
            "diffuse_shares": [round(float(share), 6) for share in posterior.diffuse_share_k],
            "directions_deg": [_degrees(azimuth) for azimuth in self.grid.azimuths],
        }

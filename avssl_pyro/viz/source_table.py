"""Table of localized sources with their uncertainty, and with their errors where the truth is known."""

from collections.abc import Mapping, Sequence

import numpy as np
from rich import box
from rich.table import Table

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.localization.posterior import LocalizedSource


def source_table(estimates: Mapping[str, Sequence[LocalizedSource]], talkers: Sequence[float] = ()) -> Table:
    """One row for each source, in degrees, with its distance from the nearest true azimuth.

    Args:
        estimates: sources by the name of the method.
        talkers: true azimuths, radians.
    """
    table = Table(box=box.SIMPLE_HEAD)
    headings = ["azimuth (°)", "± (°)", "level", "±", *(["off the nearest talker by (°)"] if len(talkers) else [])]
    table.add_column("")
    for heading in headings:
        table.add_column(heading, justify="right")
    for name, sources in estimates.items():
        if not sources:
            table.add_row(name, *["–"] * len(headings), end_section=True)
        for source in sources:
            offset = _offset(source.azimuth, talkers)
            table.add_row(
                name if source is sources[0] else "",
                f"{np.rad2deg(source.azimuth):+.1f}",
                f"{np.rad2deg(source.azimuth_std):.1f}",
                f"{source.level:.2f}",
                f"{source.level_std:.3f}",
                *([] if offset is None else [f"{np.rad2deg(offset):+.1f}"]),
                end_section=source is sources[-1],
            )
    return table


def _offset(azimuth: float, talkers: Sequence[float]) -> float | None:
    """Signed angle from the nearest talker, radians."""
    offsets = wrap_angle(azimuth - np.asarray(talkers, dtype=np.float64))
    return float(offsets[np.abs(offsets).argmin()]) if len(offsets) else None

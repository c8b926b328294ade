"""The documented results of a whole recording, in degrees: JSON lines ``avssl-window/1``, and rows of DCASE's CSV."""

import json
from collections.abc import Iterator

import numpy as np

from avssl_pyro.io.dcase import FRAME_S, DcaseRow
from avssl_pyro.tracking.timeline import Timeline, TimelineFrame

FORMAT = "avssl-window/1"


def json_lines(timeline: Timeline, name_field: str) -> str:
    """One line per localized window, whole recordings in order.

    Args:
        timeline: what was found.
        name_field: what a source's name is called, such as ``track``.

    Returns:
        Lines with ``format``, ``time_s`` (of the window's middle, from the recording's start) and ``sources``, loudest
        first, each with its name, ``azimuth_deg``, ``azimuth_std_deg`` and ``level``.
    """
    return "".join(f"{json.dumps(_window_dict(moment, name_field), allow_nan=False)}\n" for moment in timeline.moments)


def _window_dict(moment: TimelineFrame, name_field: str) -> dict[str, object]:
    return {
        "format": FORMAT,
        "time_s": round(moment.time_s, 3),
        "sources": [
            {
                name_field: source.name,
                "azimuth_deg": round(float(np.rad2deg(source.azimuth)), 2),
                "azimuth_std_deg": round(float(np.rad2deg(source.azimuth_std)), 2),
                "level": round(source.level, 4),
            }
            for source in moment.sources
        ],
    }


def dcase_rows(timeline: Timeline, end_s: float) -> Iterator[DcaseRow]:
    """The sources of every 100-ms frame; class and elevation are not estimated, and 0.

    Args:
        timeline: what was found.
        end_s: where the recording ends; a frame counts if its middle lies before it.
    """
    for frame in range(round(end_s / FRAME_S)):
        for source in timeline.at((frame + 0.5) * FRAME_S):
            yield DcaseRow(frame, 0, source.name, float(np.rad2deg(source.azimuth)))

"""Results of a recording as JSON lines ``avssl-window/1`` and DCASE's CSV rows."""

import json
from collections.abc import Iterator

import numpy as np

from avssl_pyro.io.dcase import FRAME_S, DcaseRow
from avssl_pyro.tracking.timeline import Timeline, TimelineFrame

FORMAT = "avssl-window/1"


def json_lines(timeline: Timeline, name_field: str) -> str:
    """Returns one JSON line per localized window, in order.

    Args:
        timeline: sources of the recording.
        name_field: JSON field of a source's name, such as ``track``.

    Returns:
        Lines with ``format``, ``time_s`` (of the window's middle, from the recording's start) and ``sources``, loudest
        first, each with its name, ``azimuth_deg``, ``azimuth_std_deg`` and ``level``.
    """
    return "".join(f"{json.dumps(_window_dict(frame, name_field), allow_nan=False)}\n" for frame in timeline.frames)


def _window_dict(frame: TimelineFrame, name_field: str) -> dict[str, object]:
    return {
        "format": FORMAT,
        "time_s": round(frame.time_s, 3),
        "sources": [
            {
                name_field: source.name,
                "azimuth_deg": round(float(np.rad2deg(source.azimuth)), 2),
                "azimuth_std_deg": round(float(np.rad2deg(source.azimuth_std)), 2),
                "level": round(source.level, 4),
            }
            for source in frame.sources
        ],
    }


def dcase_rows(timeline: Timeline, end_s: float) -> Iterator[DcaseRow]:
    """Yields the sources of every 100 ms frame, with class and elevation 0.

    Args:
        timeline: sources of the recording.
        end_s: end of the recording in seconds; a frame counts if its middle lies before it.
    """
    for number in range(round(end_s / FRAME_S)):
        for source in timeline.at((number + 0.5) * FRAME_S):
            yield DcaseRow(number, 0, source.name, float(np.rad2deg(source.azimuth)))

"""The documented results of a whole recording, in degrees: JSON lines ``avssl-window/1``, and DCASE's CSV."""

import json

import numpy as np

from avssl_pyro.inference.timeline import Moment, Timeline

FORMAT = "avssl-window/1"
DCASE_FRAME_S = 0.1


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


def _window_dict(moment: Moment, name_field: str) -> dict[str, object]:
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


def dcase_csv(timeline: Timeline, end_s: float) -> str:
    """The sources of every 100-ms frame as DCASE writes them: frame, class, source, azimuth, elevation.

    Class and elevation are not estimated and always 0; azimuths are whole degrees, counter-clockwise, +90 is left.

    Args:
        timeline: what was found.
        end_s: where the recording ends; a frame counts if its middle lies before it.
    """
    rows: list[str] = []
    for frame in range(round(end_s / DCASE_FRAME_S)):
        for source in timeline.at((frame + 0.5) * DCASE_FRAME_S):
            azimuth_deg = (round(float(np.rad2deg(source.azimuth))) + 180) % 360 - 180
            rows.append(f"{frame},0,{source.name},{azimuth_deg},0\n")
    return "".join(rows)

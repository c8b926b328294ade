"""DCASE challenge labels in CSV: one line per source and 100 ms, no header.

Lines have one of four forms, by the number of columns:

- 4: frame, class, azimuth, elevation;
- 5: frame, class, source, azimuth, elevation;
- 6: the same with a distance in centimetres at the end;
- 7: frame, class, source, x, y, z, distance in centimetres.

Frames without a source are absent.
"""

import csv
import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.clip import SceneLabels
from avssl_pyro.errors import InputError

FRAME_S = 0.1
MERGED_DEG = 5.0
_FORMS = (4, 5, 6, 7)


@dataclass(frozen=True)
class DcaseRow:
    """One source in one frame.

    Args:
        frame: index of the 100 ms frame, from 0.
        class_index: index of the sound class; 0 where classes are not distinguished, as in the files written here.
        source: number of the source; 0 where the file has none.
        azimuth_deg: azimuth in degrees, counter-clockwise, -180 to 180; +90 is left.
        elevation_deg: elevation in degrees, -90 to 90.
        distance_cm: distance in centimetres; None where the file has none.
    """

    frame: int
    class_index: int
    source: int
    azimuth_deg: float
    elevation_deg: float = 0.0
    distance_cm: float | None = None


def read_dcase(path: Path) -> tuple[DcaseRow, ...]:
    """Reads a file of any of the four forms and returns its rows in file order.

    An empty file describes a silent recording.

    Raises:
        InputError: the file cannot be read, or a line has none of the forms; the message names the line.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file of labels.")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = [(reader.line_num, row) for reader in [csv.reader(file)] for row in reader if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as CSV ({error}).") from error
    return tuple(_row(cells, where=f"{path}, line {number}") for number, cells in lines)


def _row(cells: list[str], where: str) -> DcaseRow:
    if len(cells) not in _FORMS:
        raise InputError(f"{where}: {len(cells)} columns; DCASE labels have 4, 5, 6 or 7.")
    try:
        values = [float(cell) for cell in cells]
    except ValueError as error:
        raise InputError(f"{where}: '{','.join(cells)}' holds something else than numbers.") from error
    if not np.isfinite(values).all() or values[0] < 0 or any(value != int(value) for value in values[:2]):
        raise InputError(f"{where}: '{','.join(cells)}' does not begin with a frame and a class, or is not finite.")
    frame, class_index = int(values[0]), int(values[1])
    if len(values) == 4:
        source, azimuth_deg, elevation_deg, distance_cm = 0, values[2], values[3], None
    elif len(values) == 7:
        x, y, z = values[3:6]
        azimuth_deg = math.degrees(math.atan2(y, x))
        elevation_deg = math.degrees(math.atan2(z, math.hypot(x, y)))
        source, distance_cm = int(values[2]), values[6]
    else:
        source, azimuth_deg, elevation_deg = int(values[2]), values[3], values[4]
        distance_cm = values[5] if len(values) == 6 else None
    if abs(azimuth_deg) > 360.0 or abs(elevation_deg) > 90.0:
        raise InputError(f"{where}: azimuth {azimuth_deg:g}, elevation {elevation_deg:g} is no direction in degrees.")
    return DcaseRow(frame, class_index, source, _wrapped(azimuth_deg), elevation_deg, distance_cm)


def write_dcase(path: Path, rows: Iterable[DcaseRow]) -> None:
    """Writes rows of five columns, or of six where every row has a distance.

    Rows are sorted by frame, class and source. Azimuths are wrapped to -180..180; angles are rounded to 0.1 degrees.

    Raises:
        OSError: see :func:`avssl_pyro.atomic_file.write_atomically`.
    """
    ordered = sorted(rows, key=lambda row: (row.frame, row.class_index, row.source))
    with_distance = all(row.distance_cm is not None for row in ordered)
    lines = []
    for row in ordered:
        numbers = [row.frame, row.class_index, row.source, _wrapped(row.azimuth_deg), row.elevation_deg]
        if with_distance and row.distance_cm is not None:
            numbers.append(row.distance_cm)
        lines.append(",".join(f"{round(number, 1):.10g}" for number in numbers) + "\n")
    write_atomically(path, "".join(lines).encode())


def azimuths_by_frame(rows: Iterable[DcaseRow], merged_deg: float = MERGED_DEG) -> dict[int, tuple[float, ...]]:
    """Returns the azimuths of each frame in radians, over all classes.

    Neighbours closer than ``merged_deg`` are merged into one.
    """
    frames: dict[int, list[float]] = defaultdict(list)
    for row in rows:
        frames[row.frame].append(math.radians(row.azimuth_deg))
    return {frame: merge_azimuths(azimuths, merged_deg) for frame, azimuths in sorted(frames.items())}


def labels_between(
    rows: Iterable[DcaseRow], start_s: float, duration_s: float = 1.0, merged_deg: float = MERGED_DEG
) -> SceneLabels:
    """Returns the labels of a window: mean azimuths of the sources active in it.

    A source counts as active in a window when it is present in at least half of its frames.
    """
    first, count = round(start_s / FRAME_S), max(1, round(duration_s / FRAME_S))
    tracks: dict[tuple[int, int], list[float]] = defaultdict(list)
    for row in rows:
        if first <= row.frame < first + count:
            tracks[row.class_index, row.source].append(math.radians(row.azimuth_deg))
    active = [circular_mean(azimuths) for azimuths in tracks.values() if 2 * len(azimuths) >= count]
    return SceneLabels(merge_azimuths(active, merged_deg))


def merge_azimuths(azimuths: Iterable[float], merged_deg: float = MERGED_DEG) -> tuple[float, ...]:
    """Returns azimuths in radians, with groups of close ones replaced by their mean.

    Azimuths closer than ``merged_deg`` to a neighbour belong to its group.
    """
    groups: list[list[float]] = []
    for azimuth in sorted(azimuths):
        if groups and abs(_wrapped(math.degrees(azimuth - groups[-1][-1]))) < merged_deg:
            groups[-1].append(azimuth)
        else:
            groups.append([azimuth])
    if len(groups) > 1 and abs(_wrapped(math.degrees(groups[0][0] - groups[-1][-1]))) < merged_deg:
        groups[0] = groups.pop() + groups[0]
    return tuple(circular_mean(group) for group in groups)


def circular_mean(azimuths: list[float]) -> float:
    """Returns the circular mean of azimuths in radians, -pi to pi."""
    return math.atan2(sum(map(math.sin, azimuths)), sum(map(math.cos, azimuths)))


def _wrapped(azimuth_deg: float) -> float:
    return azimuth_deg if -180.0 <= azimuth_deg <= 180.0 else (azimuth_deg + 180.0) % 360.0 - 180.0

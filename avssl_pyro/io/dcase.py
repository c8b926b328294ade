"""Directions over time as the CSV files of the DCASE challenges: one line per source and 100 ms, no header.

Four forms are about: frame, class, azimuth, elevation; the same with a source number after the class; that with a
distance in centimetres at the end; and frame, class, source, x, y, z, distance. Frames without a source are absent.
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
        frame: number of the 100 ms frame, from 0.
        class_index: 0 where classes are not told apart, as in what this package writes.
        source: number of the source, 0 where the file has none.
        azimuth_deg: counter-clockwise, +90 is left, -180 to 180.
        elevation_deg: -90 to 90.
        distance_cm: None where the file has none.
    """

    frame: int
    class_index: int
    source: int
    azimuth_deg: float
    elevation_deg: float = 0.0
    distance_cm: float | None = None


def read_dcase(path: Path) -> tuple[DcaseRow, ...]:
    """Reads a file of any of the four forms, in the order of its lines; an empty file says that all is silent.

    Raises:
        InputError: the file cannot be read, or a line is of none of the forms; the line is named.
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
    """Writes frame, class, source, azimuth, elevation and, if every row has one, distance; sorted by frame and source.

    Azimuths are wrapped to -180..180; angles are rounded to 0.1 degrees.

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
    """Azimuths of all sources of each frame, radians, whatever their class; neighbours under ``merged_deg`` are one."""
    frames: dict[int, list[float]] = defaultdict(list)
    for row in rows:
        frames[row.frame].append(math.radians(row.azimuth_deg))
    return {frame: merge_azimuths(azimuths, merged_deg) for frame, azimuths in sorted(frames.items())}


def labels_between(
    rows: Iterable[DcaseRow], start_s: float, duration_s: float = 1.0, merged_deg: float = MERGED_DEG
) -> SceneLabels:
    """Who sounds in a stretch: every source active in at least half of its frames, at its mean azimuth."""
    first, count = round(start_s / FRAME_S), max(1, round(duration_s / FRAME_S))
    tracks: dict[tuple[int, int], list[float]] = defaultdict(list)
    for row in rows:
        if first <= row.frame < first + count:
            tracks[row.class_index, row.source].append(math.radians(row.azimuth_deg))
    heard = [circular_mean(azimuths) for azimuths in tracks.values() if 2 * len(azimuths) >= count]
    return SceneLabels(merge_azimuths(heard, merged_deg))


def merge_azimuths(azimuths: Iterable[float], merged_deg: float = MERGED_DEG) -> tuple[float, ...]:
    """Azimuths (radians), those closer than ``merged_deg`` to a neighbour replaced by the mean of the group."""
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
    """Mean direction, radians, -pi to pi."""
    return math.atan2(sum(map(math.sin, azimuths)), sum(map(math.cos, azimuths)))


def _wrapped(azimuth_deg: float) -> float:
    return azimuth_deg if -180.0 <= azimuth_deg <= 180.0 else (azimuth_deg + 180.0) % 360.0 - 180.0

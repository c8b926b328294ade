"""Audio recordings of a folder with labels: the azimuths of their talkers."""

import math
from dataclasses import dataclass
from pathlib import Path

from avssl_pyro.errors import InputError
from avssl_pyro.io.csv_table import CsvLine, read_csv_table

LABELS_NAME = "labels.csv"


@dataclass(frozen=True)
class LabeledRecording:
    """An audio file with the azimuths of its talkers.

    Args:
        path: audio file.
        azimuths: azimuths of all talkers in radians, any number.
    """

    path: Path
    azimuths: tuple[float, ...]


def read_labeled_recordings(folder: Path) -> tuple[LabeledRecording, ...]:
    """Reads ``labels.csv`` of a folder and returns its recordings in file order.

    Column ``file`` holds names relative to the folder. Column ``azimuth_deg`` holds azimuths in degrees,
    counter-clockwise from the array's x axis, with blanks between several talkers. An empty field marks a recording
    without talkers. Other columns are ignored.

    Raises:
        InputError: the folder, the list or a listed file is missing, or a line is invalid; the message names the line.
    """
    path = folder / LABELS_NAME
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of recordings.")
    table = read_csv_table(path, ("file", "azimuth_deg"))
    return _without_repeats(tuple(_labeled(folder, line) for line in table.lines), path)


def _labeled(folder: Path, line: CsvLine) -> LabeledRecording:
    path, azimuths_deg = folder / line.file_name("file"), line.cells["azimuth_deg"]
    if azimuths_deg is None:
        raise InputError(f"{line.where}: it has no field for azimuth_deg; leave the field empty if nobody talks.")
    if not path.is_file():
        raise InputError(f"{line.where}: there is no file {path}; names are relative to the folder of the list.")
    return LabeledRecording(path, tuple(_azimuth(word, line.where) for word in azimuths_deg.split()))


def _azimuth(word: str, where: str) -> float:
    try:
        azimuth_deg = float(word)
    except ValueError:
        azimuth_deg = math.nan
    if not abs(azimuth_deg) <= 360:
        raise InputError(
            f"{where}: azimuth_deg holds '{word}'; give degrees from -360 to 360, several with blanks between them."
        )
    return math.radians(azimuth_deg)


def _without_repeats(recordings: tuple[LabeledRecording, ...], path: Path) -> tuple[LabeledRecording, ...]:
    listed: set[Path] = set()
    for recording in recordings:
        if recording.path in listed:
            raise InputError(f"{path}: {recording.path.name} is listed twice; give each recording one line.")
        listed.add(recording.path)
    return recordings

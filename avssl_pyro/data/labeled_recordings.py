"""A folder of recordings without pictures, and a list that says from where talkers were heard in each."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from avssl_pyro.errors import InputError

LABELS_NAME = "labels.csv"
_REQUIRED = ("file", "azimuth_deg")


@dataclass(frozen=True)
class LabeledRecording:
    """An audio file and the talkers in it.

    Args:
        path: of the audio file.
        azimuths: of everybody who talks at some time, radians, any number.
    """

    path: Path
    azimuths: tuple[float, ...]


def read_labeled_recordings(folder: Path) -> tuple[LabeledRecording, ...]:
    """Reads ``labels.csv`` of a folder: column ``file``, relative to the folder, and column ``azimuth_deg``.

    The azimuths of several talkers stand in one field with blanks between them, counter-clockwise from the array's x
    axis; an empty field is a recording in which nobody talks. Other columns are not read.

    Raises:
        InputError: the folder, the list or a file of it is missing, or a line cannot be understood; the line is named.
    """
    path = folder / LABELS_NAME
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of recordings.")
    if not path.is_file():
        raise InputError(f"{path}: no such file; write one with the first line file,azimuth_deg and a line for each.")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            columns = tuple(reader.fieldnames or ())
            rows = [(f"{path}, line {reader.line_num}", row) for row in reader]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as CSV ({error}).") from error
    for column in _REQUIRED:
        if column not in columns:
            raise InputError(f"{path}: column '{column}' is missing; the first line must name file and azimuth_deg.")
    if not rows:
        raise InputError(f"{path}: lists no recording; give each a line such as two.wav,30 -90")
    return _without_repeats(tuple(_labeled(folder, row, where) for where, row in rows), path)


def _labeled(folder: Path, row: dict[str, str | None], where: str) -> LabeledRecording:
    name, azimuths_deg = row["file"], row["azimuth_deg"]
    if not name:
        raise InputError(f"{where}: column 'file' is empty; give the name of a WAV or FLAC file.")
    if azimuths_deg is None:
        raise InputError(f"{where}: it has no field for azimuth_deg; leave the field empty if nobody talks.")
    if not (folder / name).is_file():
        raise InputError(f"{where}: there is no file {folder / name}; names are relative to the folder of the list.")
    return LabeledRecording(folder / name, tuple(_azimuth(word, where) for word in azimuths_deg.split()))


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

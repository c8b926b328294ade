"""Collections of recordings: a folder of pairs of files, a CSV list or STARSS23, told apart by their content."""

import csv
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from avssl_pyro.errors import InputError
from avssl_pyro.io.dcase import DcaseRow
from avssl_pyro.recordings.discovery import (
    AUDIO_SUFFIXES,
    LIST_COLUMNS,
    VIDEO_SUFFIXES,
    read_recording_list,
    recordings_in_folder,
    unique_names,
)
from avssl_pyro.recordings.recording import Alignment, Recording
from avssl_pyro.recordings.starss23 import FORMATS, list_starss

_LOOKED_FOR = (
    "give a folder of videos and audio files of the same names, a CSV file with the columns video and audio, or the "
    f"folder of STARSS23 that contains {' or '.join(f'{name}_dev' for name in FORMATS)}."
)


class CollectionKind(Enum):
    """Kind of a collection of recordings."""

    FOLDER = "folder"
    LIST = "list"
    STARSS23 = "starss23"


@dataclass(frozen=True)
class Collection:
    """Opened recordings.

    Args:
        recordings: recordings with unique names.
        labels: rows of labels by recording, None for a recording without; None where the collection has no labels.
        remarks: sentences on files that were left out.
    """

    recordings: tuple[Recording, ...]
    labels: tuple[tuple[DcaseRow, ...] | None, ...] | None = None
    remarks: tuple[str, ...] = ()


def collection_kind(path: Path) -> CollectionKind:
    """Returns the kind of collection at a path.

    Raises:
        InputError: nothing is there, or its content is of no kind.
    """
    if path.is_dir():
        if any((path / f"{name}_dev").is_dir() for name in FORMATS):
            return CollectionKind.STARSS23
        if any(file.suffix.lower() in (*AUDIO_SUFFIXES, *VIDEO_SUFFIXES) for file in path.iterdir()):
            return CollectionKind.FOLDER
    elif path.is_file():
        if set(_first_line(path)) & set(LIST_COLUMNS):
            return CollectionKind.LIST
    else:
        raise InputError(f"{path}: no such file or folder; {_LOOKED_FOR}")
    raise InputError(f"{path}: is no collection of recordings; {_LOOKED_FOR}")


def _first_line(path: Path) -> list[str]:
    """Returns the cells of the first line of a CSV file; no cells if the file is none."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return next(csv.reader(file), [])
    except (UnicodeDecodeError, csv.Error):
        return []


def open_collection(
    path: Path, alignment: Alignment, audio_format: str = "mic", split: str = "dev-train"
) -> Collection:
    """Opens the recordings of a collection.

    Args:
        path: folder of pairs, CSV list or folder of STARSS23.
        alignment: alignment of the recordings; a list may replace offset and yaw.
        audio_format: format of STARSS23's audio, "mic" or "foa".
        split: split of STARSS23, "dev-train" or "dev-test".

    Raises:
        InputError: the collection is of no kind, holds no recording, or a file cannot be read.
    """
    match collection_kind(path):
        case CollectionKind.FOLDER:
            files, alone = recordings_in_folder(path, alignment)
            remarks = tuple(f"{file}: has no partner of the same name; it is left out." for file in alone)
            return Collection(unique_names(entry.open() for entry in files), remarks=remarks)
        case CollectionKind.LIST:
            return Collection(unique_names(entry.open() for entry in read_recording_list(path, alignment)))
        case CollectionKind.STARSS23:
            return _open_starss(path, alignment, audio_format, split)


def _open_starss(root: Path, alignment: Alignment, audio_format: str, split: str) -> Collection:
    files = list_starss(root, audio_format, split)
    filmed = [entry for entry in files if entry.video is not None]
    if not filmed:
        raise InputError(f"{root}: no recording of {split} has a video; expected them in video_dev.")
    left_out = len(files) - len(filmed)
    remark = f"{root}: {left_out} of {len(files)} recordings have no video; they are left out."
    return Collection(
        unique_names(entry.open(alignment) for entry in filmed),
        tuple(None if entry.labels is None else entry.read_labels() for entry in filmed),
        (remark,) if left_out else (),
    )

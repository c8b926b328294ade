"""Discovery of recordings in a folder or a CSV list.

A recording is a pair of an audio and a video file with their alignment.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from avssl_pyro.errors import InputError
from avssl_pyro.io.csv_table import CsvLine, read_csv_table
from avssl_pyro.recordings.recording import Alignment, Recording

AUDIO_SUFFIXES = (".wav", ".flac")
VIDEO_SUFFIXES = (".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v", ".mpg", ".mpeg", ".ts")
LIST_COLUMNS = ("video", "audio", "offset_s", "yaw_deg")


@dataclass(frozen=True)
class RecordingFiles:
    """Files and alignment of one recording.

    Args:
        video: video file.
        audio: audio file.
        alignment: alignment of picture and channels with the array.
    """

    video: Path
    audio: Path
    alignment: Alignment

    def open(self) -> Recording:
        """Opens the recording.

        Raises:
            InputError: a file cannot be read, or audio and video do not fit together.
        """
        return Recording.open(self.audio, self.video, self.alignment)


def recordings_in_folder(folder: Path, alignment: Alignment) -> tuple[tuple[RecordingFiles, ...], tuple[Path, ...]]:
    """Returns pairs of files with equal stems, and the files without a partner.

    Pairs are ordered by name.

    Raises:
        InputError: the folder is missing or holds no pair, or a file has two possible partners.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of recordings.")
    audio, video = _by_stem(folder, AUDIO_SUFFIXES), _by_stem(folder, VIDEO_SUFFIXES)
    pairs = tuple(RecordingFiles(video[stem], audio[stem], alignment) for stem in sorted(audio.keys() & video.keys()))
    if not pairs:
        raise InputError(
            f"{folder}: holds no recording; give each a video and a WAV or FLAC file of the same name, such as "
            "day1.mp4 and day1.wav."
        )
    alone = sorted([*(audio[stem] for stem in audio.keys() - video.keys())])
    alone += sorted(video[stem] for stem in video.keys() - audio.keys())
    return pairs, tuple(alone)


def _by_stem(folder: Path, suffixes: tuple[str, ...]) -> dict[str, Path]:
    files: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in suffixes and not path.name.startswith("."):
            if path.stem in files:
                raise InputError(f"{folder}: {files[path.stem].name} and {path.name} are both '{path.stem}'; keep one.")
            files[path.stem] = path
    return files


def read_recording_list(path: Path, alignment: Alignment) -> tuple[RecordingFiles, ...]:
    """Reads a CSV list of recordings and returns their files in file order.

    The columns are ``video``, ``audio`` and optionally ``offset_s`` and ``yaw_deg``.

    Args:
        path: CSV file; file names in it are relative to its folder.
        alignment: alignment of all recordings; an offset or yaw in a line replaces its value.

    Raises:
        InputError: the file is missing or damaged, or a line is incomplete; the message names the line.
    """
    table = read_csv_table(path, ("video", "audio"))
    unknown = [column for column in table.columns if column not in LIST_COLUMNS]
    if unknown:
        raise InputError(
            f"{path}: column '{unknown[0]}' is unknown; the first line must be: video,audio or "
            "video,audio,offset_s,yaw_deg"
        )
    return tuple(_listed(path.parent, line, alignment) for line in table.lines)


def _listed(folder: Path, line: CsvLine, alignment: Alignment) -> RecordingFiles:
    given = {column: text for column in ("offset_s", "yaw_deg") if (text := line.cells.get(column))}
    changes = {column: _number(text, column, line.where) for column, text in given.items()}
    placed = replace(alignment, **changes)  # type: ignore[arg-type]
    return RecordingFiles(folder / line.file_name("video"), folder / line.file_name("audio"), placed)


def _number(text: str, column: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where}: {column} is '{text}'; give a number.")
    return value


def unique_names(recordings: Iterable[Recording]) -> tuple[Recording, ...]:
    """Returns recordings with unique names; a repeated name gets a number."""
    taken: set[str] = set()
    named = []
    for number, recording in enumerate(recordings):
        unique = recording if recording.key not in taken else replace(recording, name=f"{recording.name}-r{number}")
        taken.add(unique.key)
        named.append(unique)
    return tuple(named)

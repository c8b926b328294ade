"""STARSS23 recordings: four channels, 360-degree video and labels.

The channels are microphones on a rigid sphere or first-order ambisonics. The files are::

    root/{mic,foa}_dev/dev-{train,test}-{sony,tau}/fold4_room1_mix001.wav
    root/video_dev/dev-train-sony/fold4_room1_mix001.mp4        (or without the folder between)
    root/metadata_dev/dev-train-sony/fold4_room1_mix001.csv     (or without the folder between)

The labels serve evaluation alone; training does not use them.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from avssl_pyro.errors import InputError
from avssl_pyro.io.dcase import DcaseRow, read_dcase
from avssl_pyro.recordings.recording import Alignment, Recording

FORMATS = ("mic", "foa")
SPLITS = ("dev-train", "dev-test")
_NAME = re.compile(r"fold(\d+)_room(\d+)_mix(\d+)")


@dataclass(frozen=True)
class StarssFiles:
    """Files of one recording.

    Args:
        name: stem of the file names.
        fold: number of the fold.
        room: number of the room.
        mix: number of the recording in its room.
        audio: audio file.
        video: video file; None where the data set has none.
        labels: file of labels; None where the data set has none.
    """

    name: str
    fold: int
    room: int
    mix: int
    audio: Path
    video: Path | None
    labels: Path | None

    def open(self, alignment: Alignment | None = None) -> Recording:
        """Opens the recording; picture and sound agree in STARSS23 itself, so no alignment is the default.

        Raises:
            InputError: a file cannot be read.
        """
        return Recording.open(self.audio, self.video, alignment)

    def read_labels(self) -> tuple[DcaseRow, ...]:
        """Reads the labels of the recording.

        Raises:
            InputError: there are no labels, or they cannot be read.
        """
        if self.labels is None:
            raise InputError(f"recording '{self.name}' has no labels; look for {self.name}.csv in metadata_dev.")
        return read_dcase(self.labels)


def list_starss(root: Path, audio_format: str, split: str) -> tuple[StarssFiles, ...]:
    """Returns the recordings of a split, ordered by name.

    Args:
        root: folder with ``mic_dev`` or ``foa_dev``.
        audio_format: format of the audio, "mic" or "foa".
        split: name of the split, "dev-train" or "dev-test".

    Raises:
        InputError: the format or split does not exist, or ``root`` holds no recording of it.
    """
    if audio_format not in FORMATS or split not in SPLITS:
        raise InputError(
            f"{root}: STARSS23 has no format '{audio_format}' with split '{split}'; formats are {' and '.join(FORMATS)}"
            f", splits {' and '.join(SPLITS)}."
        )
    paths = sorted((root / f"{audio_format}_dev").glob(f"{split}*/*.wav"), key=lambda path: path.name)
    if not paths:
        raise InputError(
            f"{root}: no recordings; expected {audio_format}_dev/{split}-sony/fold..._room..._mix....wav or the same "
            f"with {split}-tau."
        )
    return tuple(_files(root, path) for path in paths)


def _files(root: Path, audio: Path) -> StarssFiles:
    found = _NAME.fullmatch(audio.stem)
    if found is None:
        raise InputError(f"{audio}: not named as STARSS23 names its recordings, such as fold4_room1_mix001.wav.")
    fold, room, mix = (int(number) for number in found.groups())
    video = _beside(root / "video_dev", audio, ".mp4")
    return StarssFiles(audio.stem, fold, room, mix, audio, video, _beside(root / "metadata_dev", audio, ".csv"))


def _beside(folder: Path, audio: Path, suffix: str) -> Path | None:
    name = audio.stem + suffix
    return next((path for path in (folder / audio.parent.name / name, folder / name) if path.is_file()), None)

"""Excerpts of a recording for diagnosis: evenly spread windows of one second."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import soundfile

from avssl_pyro.clip import SAMPLE_RATE, Clip
from avssl_pyro.errors import InputError
from avssl_pyro.io.audio import MIN_SECONDS, check_live, check_samples, resample

EXCERPT_SECONDS = 1.0
MOST_EXCERPTS = 60


@dataclass(frozen=True)
class Excerpts:
    """Evenly spread excerpts of equal length, at the file's rate and at 16 kHz.

    Args:
        raw_bmn: samples at the rate of the file, float32 in [-1, 1], (B, M, N); resampling would hide clipping.
        rate: sample rate of ``raw_bmn`` in Hz.
        audio_bmn: samples at 16 kHz, float32, (B, M, N').
        names: channel numbers in the file, from 0.
    """

    raw_bmn: npt.NDArray[np.float32]
    rate: int
    audio_bmn: npt.NDArray[np.float32]
    names: tuple[int, ...]

    @property
    def num_channels(self) -> int:
        return self.raw_bmn.shape[1]

    def check_live(self, path: Path) -> None:
        """Checks that no channel of the recording is dead.

        Args:
            path: audio file, for the message.

        Raises:
            InputError: a channel is dead.
        """
        check_live(np.concatenate(list(self.raw_bmn), axis=-1), path, self.names)

    def select(self, channels: Sequence[int]) -> "Excerpts":
        """Returns the excerpts of the given channels (from 0), in the given order."""
        chosen = list(channels)
        names = tuple(self.names[channel] for channel in chosen)
        return Excerpts(self.raw_bmn[:, chosen], self.rate, self.audio_bmn[:, chosen], names)

    @classmethod
    def of_blocks(cls, raw_bmn: npt.NDArray[np.float32], rate: int) -> "Excerpts":
        """Builds excerpts from blocks (B, M, N) at a sample rate in Hz."""
        names = tuple(range(raw_bmn.shape[1]))
        audio_bmn = raw_bmn if rate == SAMPLE_RATE else np.ascontiguousarray(resample(raw_bmn, rate, axis=-1))
        return cls(raw_bmn, rate, audio_bmn, names)

    @classmethod
    def of_clips(cls, clips: Sequence[Clip]) -> "Excerpts":
        """Builds excerpts from clips of one array, each cut to the shortest.

        Raises:
            InputError: no clip is given.
        """
        if not clips:
            raise InputError("no clip was given; a diagnosis needs at least one.")
        shortest = min(clip.audio_mn.shape[1] for clip in clips)
        return cls.of_blocks(np.stack([clip.audio_mn[:, :shortest] for clip in clips]), SAMPLE_RATE)


def evenly(total: int, most: int) -> list[int]:
    """Returns at most ``most`` of ``total`` indices, evenly spread."""
    count = min(total, most)
    return [(2 * index + 1) * total // (2 * count) for index in range(count)]


def read_excerpts(path: Path, most: int = MOST_EXCERPTS) -> Excerpts:
    """Reads up to ``most`` excerpts of one second, evenly spread over a file.

    Args:
        path: WAV or FLAC file of any length, sample rate and channel count.
        most: largest number of excerpts.

    Raises:
        InputError: the file cannot be read, is shorter than 0.1 s or holds samples that are not finite.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such audio file.")
    try:
        with soundfile.SoundFile(path) as file:
            rate, frames = file.samplerate, file.frames
            if frames < MIN_SECONDS * rate:
                raise InputError(f"{path}: {frames} samples at {rate} Hz; at least {MIN_SECONDS:g} s are needed.")
            length = min(frames, round(EXCERPT_SECONDS * rate))
            blocks = []
            for index in evenly(frames // length, most):
                file.seek(index * length)
                block_nm = file.read(length, dtype="float32", always_2d=True)
                if len(block_nm) < length:
                    raise InputError(f"{path}: it is shorter than its header states; the file is truncated or damaged.")
                check_samples(block_nm, path, index * length)
                blocks.append(block_nm.T)
    except (soundfile.SoundFileError, RuntimeError) as error:
        raise InputError(f"{path}: cannot be read as audio ({error}); give WAV or FLAC.") from error
    raw_bmn = np.stack(blocks)
    return Excerpts.of_blocks(raw_bmn, rate)

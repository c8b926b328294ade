"""A long recording of a microphone array, read piece by piece at 16 kHz."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import gcd
from pathlib import Path

import numpy as np
import numpy.typing as npt
import soundfile
from scipy.signal import resample_poly

from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.errors import InputError

# Float files of 32-bit integers that nobody scaled are the largest that make sense.
MAX_AMPLITUDE = 2.0**31
# resample_poly's filter spans ten samples of the slower rate to each side; twice that is out of its reach.
_CONTEXT = 20


@dataclass(frozen=True)
class AudioFile:
    """WAV or FLAC of any channel count, rate and sample format; only its header is read until samples are asked for.

    Args:
        path: of the file.

    Raises:
        InputError: it is missing, cannot be read as audio, or holds no samples.
    """

    path: Path

    def __post_init__(self) -> None:
        if not self.path.is_file():
            raise InputError(f"{self.path}: no such audio file.")
        if not self._header[2]:
            raise InputError(f"{self.path}: holds no samples; give a recording.")

    @cached_property
    def _header(self) -> tuple[int, int, int]:
        try:
            with soundfile.SoundFile(self.path) as file:
                return file.channels, file.samplerate, file.frames
        except (soundfile.SoundFileError, RuntimeError) as error:
            raise _unreadable(self.path, error) from error

    @property
    def num_channels(self) -> int:
        return self._header[0]

    @property
    def sample_rate(self) -> int:
        """Of the file, Hz."""
        return self._header[1]

    @property
    def duration_s(self) -> float:
        return self._header[2] / self.sample_rate

    @property
    def num_samples(self) -> int:
        """At 16 kHz."""
        return self._header[2] * SAMPLE_RATE // self.sample_rate

    def read(self, start_s: float, duration_s: float) -> npt.NDArray[np.float32]:
        """A stretch as float32 (M, N) at 16 kHz, the same samples as if the whole file had been resampled.

        Raises:
            InputError: the stretch is not inside the file, the file is damaged there, or a sample is not finite.
        """
        return self.read_samples(round(start_s * SAMPLE_RATE), round(duration_s * SAMPLE_RATE))

    def read_samples(self, first: int, count: int) -> npt.NDArray[np.float32]:
        """As :meth:`read`, in samples at 16 kHz."""
        if first < 0 or count < 1 or first + count > self.num_samples:
            raise InputError(
                f"{self.path}: {first / SAMPLE_RATE:.3f} to {(first + count) / SAMPLE_RATE:.3f} s was asked for; "
                f"the file lasts from 0 to {self.duration_s:.3f} s."
            )
        divisor = gcd(self.sample_rate, SAMPLE_RATE)
        up, down = SAMPLE_RATE // divisor, self.sample_rate // divisor
        # Samples of file and output coincide every `down` and `up` of them; reading starts at such a place.
        context = _CONTEXT * max(up, down) // up + 1 if up != down else 0
        block = max(0, first * down // up - context) // down
        last = min(self._header[2], -(-(first + count) * down // up) + context)
        audio_nm = self._read_frames(block * down, last - block * down)
        if up != down:
            audio_nm = resample_poly(audio_nm, up, down, axis=0)
        skip = first - block * up
        return np.ascontiguousarray(audio_nm[skip : skip + count].T, dtype=np.float32)

    def blocks(self, block_s: float = 10.0) -> Iterator[npt.NDArray[np.float32]]:
        """The whole file in order, (M, N) each; the last block may be shorter."""
        size = round(block_s * SAMPLE_RATE)
        for first in range(0, self.num_samples, size):
            yield self.read_samples(first, min(size, self.num_samples - first))

    def _read_frames(self, first: int, count: int) -> npt.NDArray[np.float32]:
        try:
            with soundfile.SoundFile(self.path) as file:
                file.seek(first)
                audio_nm = file.read(count, dtype="float32", always_2d=True)
        except (soundfile.SoundFileError, RuntimeError) as error:
            raise _unreadable(self.path, error) from error
        if len(audio_nm) < count:
            raise InputError(
                f"{self.path}: it ends at {(first + len(audio_nm)) / self.sample_rate:.3f} s, although its header says "
                f"{self.duration_s:.3f} s; the file is truncated or damaged."
            )
        check_samples(audio_nm, self.path, first)
        return audio_nm


def check_samples(
    audio_nm: npt.NDArray[np.float32], path: Path | str, first: int = 0, channels: Sequence[int] | None = None
) -> None:
    """Raises InputError for samples that are not finite or absurdly large.

    Args:
        audio_nm: samples, (N, M).
        path: their file.
        first: number of the first sample in the file.
        channels: of the file, counted from 0, that the columns are; by default all of them.
    """
    if not np.isfinite(audio_nm).all():
        frame, column = np.argwhere(~np.isfinite(audio_nm))[0]
        channel = column if channels is None else channels[column]
        raise InputError(
            f"{path}: sample {first + frame} of channel {channel + 1} is not a finite number; export the recording "
            "again."
        )
    largest = float(np.abs(audio_nm).max(initial=0.0))
    if largest > MAX_AMPLITUDE:
        raise InputError(
            f"{path}: a sample is as large as {largest:.3g} where full scale is 1; export the recording again."
        )


def check_live(audio_mn: npt.NDArray[np.float32], path: Path | str, channels: Sequence[int]) -> None:
    """Raises InputError if some channels never change while others do: their microphones or cables are dead.

    Args:
        audio_mn: samples, (M, N), from all over a recording.
        path: its file.
        channels: of the file, counted from 0, that the rows are.
    """
    dead_m = audio_mn.min(axis=1) == audio_mn.max(axis=1)
    if dead_m.any() and not dead_m.all():
        names = ", ".join(str(channel + 1) for channel, dead in zip(channels, dead_m, strict=True) if dead)
        raise InputError(
            f"{path}: channel {names} is dead, constant throughout; record again, or leave its microphone out of the "
            "array file."
        )


def _unreadable(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: cannot be read as audio ({error}); give WAV or FLAC.")

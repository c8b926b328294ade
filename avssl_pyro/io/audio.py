"""Audio files: whole clips, pieces of long recordings at 16 kHz, and separated sources as WAV."""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import gcd
from pathlib import Path

import numpy as np
import numpy.typing as npt
import soundfile
from scipy.signal import resample_poly

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.compatibility import check_channels
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.errors import InputError

MAX_SECONDS = 10.0
MIN_SECONDS = 0.1
# Float files of 32-bit integers that nobody scaled are the largest that make sense.
MAX_AMPLITUDE = 2.0**31
# resample_poly's filter spans ten samples of the slower rate to each side; twice that is out of its reach.
_CONTEXT = 20


@dataclass(frozen=True)
class AudioFile:
    """A WAV or FLAC file of any channel count, rate and sample format, read in pieces.

    Only the header is read before the first piece.

    Args:
        path: audio file.

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
        """Sample rate of the file in Hz."""
        return self._header[1]

    @property
    def duration_s(self) -> float:
        return self._header[2] / self.sample_rate

    @property
    def num_samples(self) -> int:
        """Number of samples at 16 kHz."""
        return self._header[2] * SAMPLE_RATE // self.sample_rate

    def read(self, start_s: float, duration_s: float) -> npt.NDArray[np.float32]:
        """Reads a stretch as float32 (M, N) at 16 kHz, equal to that part of the whole file resampled.

        Raises:
            InputError: the stretch is not inside the file, the file is damaged there, or a sample is not finite.
        """
        return self.read_samples(round(start_s * SAMPLE_RATE), round(duration_s * SAMPLE_RATE))

    def read_samples(self, first: int, count: int) -> npt.NDArray[np.float32]:
        """Reads a stretch given in samples at 16 kHz; see :meth:`read`."""
        if first < 0 or count < 1 or first + count > self.num_samples:
            raise InputError(
                f"{self.path}: {first / SAMPLE_RATE:.3f} to {(first + count) / SAMPLE_RATE:.3f} s requested; "
                f"the file lasts from 0 to {self.duration_s:.3f} s."
            )
        divisor = gcd(self.sample_rate, SAMPLE_RATE)
        up, down = SAMPLE_RATE // divisor, self.sample_rate // divisor
        # Samples of file and output coincide every `down` and `up` of them; reading starts at such a place.
        context = _CONTEXT * max(up, down) // up + 1 if up != down else 0
        block = max(0, first * down // up - context) // down
        last = min(self._header[2], -(-(first + count) * down // up) + context)
        audio_nm = self._read_frames(block * down, last - block * down)
        audio_nm = resample(audio_nm, self.sample_rate)
        skip = first - block * up
        return np.ascontiguousarray(audio_nm[skip : skip + count].T, dtype=np.float32)

    def blocks(self, block_s: float = 10.0) -> Iterator[npt.NDArray[np.float32]]:
        """Reads the whole file in order, (M, N) a block; the last one may be shorter."""
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
                f"{self.path}: it ends at {(first + len(audio_nm)) / self.sample_rate:.3f} s, but its header has "
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
        path: audio file.
        first: index of the first sample in the file.
        channels: file channels of the columns, counted from 0; by default all.
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
    """Raises InputError if some channels are constant while others are not.

    Args:
        audio_mn: samples, (M, N), from excerpts of the whole recording.
        path: audio file.
        channels: file channels of the rows, counted from 0.
    """
    dead_m = audio_mn.min(axis=1) == audio_mn.max(axis=1)
    if dead_m.any() and not dead_m.all():
        names = ", ".join(str(channel + 1) for channel, dead in zip(channels, dead_m, strict=True) if dead)
        raise InputError(
            f"{path}: channel {names} is dead, constant throughout; record again, or leave its microphone out of the "
            "array file."
        )


def read_audio(path: Path, array: MicrophoneArray) -> npt.NDArray[np.float32]:
    """Reads a clip from WAV or FLAC: the array's channels, float32 (M, N) at 16 kHz.

    Raises:
        InputError: the file cannot be read, has the wrong number of channels, is too short or too long, or holds
            samples that are not finite, or is silent in some channels alone.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such audio file.")
    try:
        with soundfile.SoundFile(path) as file:
            rate = file.samplerate
            check_channels(file.channels, array, str(path))
            _check_duration(file.frames, rate, str(path))
            audio_nm = file.read(dtype="float32", always_2d=True)
    except (soundfile.SoundFileError, RuntimeError) as error:
        raise _unreadable(path, error) from error
    return fit_audio(audio_nm, rate, array, str(path))


def fit_audio(
    audio_nm: npt.NDArray[np.float32], rate: int, array: MicrophoneArray, where: str
) -> npt.NDArray[np.float32]:
    """Returns samples of the array's microphones in its order, float32 (M, N) at 16 kHz.

    Args:
        audio_nm: samples of all channels, (N, channels).
        rate: sample rate in Hz.
        array: microphones and the channels they are on.
        where: name of the recording in error messages.

    Raises:
        InputError: the number of channels is wrong, the clip is too short or too long, samples are not finite, or some
            channels alone are silent.
    """
    check_channels(audio_nm.shape[1], array, where)
    _check_duration(len(audio_nm), rate, where)
    audio_nm = audio_nm[:, list(array.channel_indices)]
    check_samples(audio_nm, where, channels=array.channel_indices)
    check_live(audio_nm.T, where, array.channel_indices)
    return np.ascontiguousarray(resample(audio_nm, rate).T, dtype=np.float32)


def _check_duration(frames: int, rate: int, where: str) -> None:
    if frames > MAX_SECONDS * rate:
        raise InputError(
            f"{where}: {frames / rate:.1f} s long; a clip may last up to {MAX_SECONDS:g} s, so cut out a part "
            "during which nobody moves."
        )
    if frames < MIN_SECONDS * rate:
        raise InputError(
            f"{where}: {frames} samples ({1e3 * frames / rate:.0f} ms); a clip needs at least "
            f"{1e3 * MIN_SECONDS:.0f} ms."
        )


def resample(
    audio: npt.NDArray[np.float32], rate: int, axis: int = 0, new_rate: int = SAMPLE_RATE
) -> npt.NDArray[np.float32]:
    """Resamples audio at a rate in Hz to another one, by default 16 kHz, along an axis."""
    if rate == new_rate:
        return audio
    divisor = gcd(rate, new_rate)
    return np.asarray(resample_poly(audio, new_rate // divisor, rate // divisor, axis=axis), dtype=np.float32)


def write_separated(
    folder: Path, name: str, azimuths: Sequence[float], sound_sn: npt.NDArray[np.float32]
) -> list[Path]:
    """Writes ``NAME-source1-az+034.wav`` and so on: mono, 16 kHz, 32-bit float, so that nothing is clipped.

    Args:
        folder: output folder, created where missing.
        name: beginning of the file names.
        azimuths: azimuths of the sources in radians, (S,); file names have degrees.
        sound_sn: samples of the sources, (S, N).

    Returns:
        Paths in the order of the sources.

    Raises:
        OSError: the folder cannot be written to; every file is there whole or not at all.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, (azimuth, sound_n) in enumerate(zip(azimuths, sound_sn, strict=True), start=1):
        stream = io.BytesIO()
        soundfile.write(stream, sound_n, SAMPLE_RATE, format="WAV", subtype="FLOAT")
        path = folder / f"{name}-source{number}-az{round(float(np.rad2deg(azimuth))):+04d}.wav"
        write_atomically(path, stream.getvalue())
        paths.append(path)
    return paths


def _unreadable(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: cannot be read as audio ({error}); give WAV or FLAC.")

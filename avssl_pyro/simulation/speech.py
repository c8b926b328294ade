"""Dry speech of talkers: the interface of a source, and a source that reads a folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt
import soundfile

from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.errors import InputError
from avssl_pyro.io.audio import resample
from avssl_pyro.simulation.assets import AssetFolder

FRAME_SAMPLES = SAMPLE_RATE // 50
# A frame counts as speech when it lies within 30 dB of the loud ones, an excerpt when this share of its frames does.
ACTIVE_RANGE_DB = 30.0
ACTIVE_SHARE = 0.7
# Of a long recording one random stretch of this length is read, so that an hour costs no more than a sentence.
STRETCH_S = 20.0


class SpeechSource(Protocol):
    """A source of dry speech."""

    @property
    def name(self) -> str:
        """Short name for manifests, e.g. ``procedural``."""
        ...

    def describe(self) -> str:
        """One readable line: kind and number of the voices."""
        ...

    def draw(self, rng: np.random.Generator, num_samples: int) -> npt.NDArray[np.float32]:
        """Draws an excerpt of continuous speech, float32 (N,), 16 kHz, unit RMS."""
        ...


def normalize(speech_n: npt.NDArray[np.floating], where: str) -> npt.NDArray[np.float32]:
    """Scales speech to unit RMS, float32 (N,).

    Raises:
        InputError: the signal is silent; the message begins with ``where``.
    """
    rms = float(np.sqrt(np.mean(np.square(speech_n, dtype=np.float64))))
    if rms < 1e-6:
        raise InputError(f"{where}: the recording is silent; every speech file must contain audible speech.")
    return (speech_n / rms).astype(np.float32)


def active_excerpt(
    speech_n: npt.NDArray[np.floating], num_samples: int, rng: np.random.Generator
) -> npt.NDArray[np.floating]:
    """Draws an excerpt, (num_samples,), in which the talker is active most of the time.

    A shorter signal is padded with silence to a random position.
    """
    spare = len(speech_n) - num_samples
    if spare <= 0:
        before = int(rng.integers(0, -spare + 1))
        return np.pad(speech_n, (before, -spare - before))
    num_frames = len(speech_n) // FRAME_SAMPLES
    frames = speech_n[: num_frames * FRAME_SAMPLES].reshape(num_frames, FRAME_SAMPLES)
    power_t = np.mean(np.square(frames, dtype=np.float64), axis=1)
    active_t = power_t > np.quantile(power_t, 0.95) * 10 ** (-ACTIVE_RANGE_DB / 10)
    span = min(-(-num_samples // FRAME_SAMPLES), num_frames)
    counts = np.concatenate([[0], np.cumsum(active_t)])
    share_t = (counts[span:] - counts[:-span]) / span
    starts = np.flatnonzero(share_t >= min(ACTIVE_SHARE, share_t.max()))
    start = min(int(rng.choice(starts)) * FRAME_SAMPLES + int(rng.integers(FRAME_SAMPLES)), spare)
    return speech_n[start : start + num_samples]


STRETCHES_TRIED = 5
AUDIBLE = 1e-4


@dataclass(frozen=True)
class SpeechFolder(AssetFolder):
    """Speech from the WAV and FLAC files under a folder, of any rate; channels are averaged.

    Keep speakers of training and test in different folders.

    Raises:
        InputError: the folder is missing or empty; on drawing, a file cannot be read or has no audible speech.
    """

    suffixes: ClassVar[frozenset[str]] = frozenset({".wav", ".flac"})
    kind: ClassVar[str] = "speech"
    plural: ClassVar[str] = "speech files"

    def draw(self, rng: np.random.Generator, num_samples: int) -> npt.NDArray[np.float32]:
        """Draws an excerpt of continuous speech of a random file, float32 (N,), 16 kHz, unit RMS."""
        return self.draw_from(self.paths[int(rng.integers(len(self.paths)))], rng, num_samples)

    def draw_from(self, path: Path, rng: np.random.Generator, num_samples: int) -> npt.NDArray[np.float32]:
        """Draws an excerpt of one file of the folder; see :meth:`draw`."""
        # A long recording may be silent in one stretch; it is an error only if all stretches are silent.
        for attempt in range(STRETCHES_TRIED):
            excerpt_n = active_excerpt(read_stretch(path, num_samples / SAMPLE_RATE, rng), num_samples, rng)
            if attempt == STRETCHES_TRIED - 1 or np.abs(excerpt_n).max() > AUDIBLE:
                break
        return normalize(excerpt_n, str(path))


def read_stretch(path: Path, seconds: float, rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """Reads speech, averaged over channels and resampled to 16 kHz, (N,); of a long file a random stretch.

    Args:
        path: audio file.
        seconds: least duration of the stretch; shorter files are read whole.
        rng: random position of the stretch.

    Raises:
        InputError: the file cannot be read, is empty, or has non-finite samples.
    """
    try:
        with soundfile.SoundFile(path) as file:
            rate, frames = file.samplerate, file.frames
            wanted = int(max(STRETCH_S, 2 * seconds) * rate)
            if frames > wanted:
                file.seek(int(rng.integers(frames - wanted + 1)))
            audio_nm = file.read(wanted, dtype="float32", always_2d=True)
    except (soundfile.SoundFileError, OSError) as error:
        raise InputError(f"{path}: cannot read the speech file ({error}); give WAV or FLAC.") from error
    if len(audio_nm) == 0:
        raise InputError(f"{path}: the speech file is empty; it must contain audible speech.")
    speech_n: npt.NDArray[np.float32] = audio_nm.mean(axis=1, dtype=np.float32)
    if not np.isfinite(speech_n).all():
        raise InputError(f"{path}: the speech file has NaN or infinite samples; all must be finite.")
    return resample(speech_n, rate)

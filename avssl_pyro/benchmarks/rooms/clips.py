"""Clips of one, two and no talkers, made from measured room responses and dry speech."""

import io
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import soundfile
from scipy.signal import fftconvolve

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.benchmarks.rooms.responses import RoomResponse
from avssl_pyro.clip import CLIP_SAMPLES, SAMPLE_RATE, Clip
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.metrics import Azimuths
from avssl_pyro.recordings.labeled_recordings import LABELS_NAME
from avssl_pyro.simulation.speech import SpeechFolder

ONE_TALKER, TWO_TALKERS = "1 talker", "2 talkers"
WHITE, PINK, SILENCE = "white noise", "diffuse pink noise", "silence"
NOBODY = (WHITE, PINK, SILENCE)
KINDS = (ONE_TALKER, TWO_TALKERS, *NOBODY)
# After half a second of speech the reverberation is steady.
LEAD_IN = SAMPLE_RATE // 2
NOISE_DB = (25.0, 30.0)
LEVEL_DIFFERENCE_DB = 5.0
# Closer talkers could each be matched by an estimate of the other.
MIN_SEPARATION_DEG = 20.0
LEAST_DIFFUSE, MOST_DIFFUSE = 8, 32
PEAK, NOISE_RMS = 0.5, 0.1
LOWEST_PINK_HZ = 20.0
# A drawn second of speech is too quiet if it is this much below the excerpt's mean.
QUIET_DB = 20.0
TRIES = 20


@dataclass(frozen=True, eq=False)
class RoomClip:
    """A clip with the directions of its talkers.

    Args:
        clip: audio of the array's microphones, in their order.
        kind: one of :data:`KINDS`.
        azimuths: azimuths of the talkers, radians.
        responses: responses of the talkers.
    """

    clip: Clip
    kind: str
    azimuths: Azimuths
    responses: tuple[RoomResponse, ...] = ()


@dataclass(frozen=True)
class RoomClips:
    """A source of one-second clips, each drawn from the seed, its kind and its number alone.

    Args:
        responses: measured responses of the array.
        speech: dry speech.
        num_microphones: number of the array's microphones.
        seed: seed of all draws.
    """

    responses: tuple[RoomResponse, ...]
    speech: SpeechFolder
    num_microphones: int
    seed: int = 0

    def draw_all(self, one: int, two: int, nobody: int) -> list[RoomClip]:
        """Draws clips of one talker, of two, and of nobody: white noise, diffuse pink noise and silence in turn.

        Raises:
            InputError: no setting has two directions for two talkers, or enough responses for diffuse noise, or a file
                cannot be read.
        """
        numbers = {ONE_TALKER: one, TWO_TALKERS: two} | {
            kind: len(range(first, nobody, len(NOBODY))) for first, kind in enumerate(NOBODY)
        }
        return [self.draw(kind, index) for kind, number in numbers.items() for index in range(number)]

    def draw(self, kind: str, index: int) -> RoomClip:
        """Draws one clip; see :meth:`draw_all`."""
        rng = np.random.default_rng([self.seed, KINDS.index(kind), index])
        talkers: tuple[RoomResponse, ...] = ()
        if kind == ONE_TALKER:
            talkers = (self._one(index),)
        elif kind == TWO_TALKERS:
            talkers = self._pair(rng)
        audio_mn = self._talking(talkers, rng) if talkers else self._nobody(kind, index, rng)
        key = f"{kind.replace(' ', '-')}-{index + 1:03d}"
        azimuths = np.array([response.azimuth for response in talkers])
        return RoomClip(Clip.from_audio(key, audio_mn.astype(np.float32)), kind, azimuths, talkers)

    def _one(self, index: int) -> RoomResponse:
        """Every response once before any comes again."""
        turn, place = divmod(index, len(self.responses))
        order = np.random.default_rng([self.seed, len(KINDS), turn]).permutation(len(self.responses))
        return self.responses[order[place]]

    def _pair(self, rng: np.random.Generator) -> tuple[RoomResponse, RoomResponse]:
        for first in rng.permutation(len(self.responses)):
            one = self.responses[first]
            others = [other for other in self.responses if other.setting == one.setting and _apart(one, other)]
            if others:
                return one, others[int(rng.integers(len(others)))]
        raise InputError(
            f"{LABELS_NAME}: no setting has two directions at least {MIN_SEPARATION_DEG:g} degrees apart for two "
            "talkers; give more responses, or 0 for the second number of --num-clips."
        )

    def _talking(self, talkers: Sequence[RoomResponse], rng: np.random.Generator) -> npt.NDArray[np.float64]:
        paths = self.speech.paths
        files = rng.choice(len(paths), len(talkers), replace=len(paths) < len(talkers))
        audio_mn = np.zeros((self.num_microphones, CLIP_SAMPLES))
        for number, (response, file) in enumerate(zip(talkers, files, strict=True)):
            below_db = rng.uniform(0, LEVEL_DIFFERENCE_DB) if number else 0.0
            wet_mn = fftconvolve(self._dry(paths[file], rng)[None], response.impulse_mn(), axes=1)
            wet_mn = wet_mn[:, LEAD_IN : LEAD_IN + CLIP_SAMPLES]
            audio_mn += 10 ** (-below_db / 20) * wet_mn / wet_mn.std()
        noise_mn = rng.standard_normal(audio_mn.shape)
        return _scaled(audio_mn + 10 ** (-rng.uniform(*NOISE_DB) / 20) * audio_mn.std() * noise_mn)

    def _dry(self, path: Path, rng: np.random.Generator) -> npt.NDArray[np.float32]:
        """Speech of unit RMS, (N,), in the last second of which somebody speaks."""
        for _ in range(TRIES):
            dry_n = self.speech.draw_from(path, rng, LEAD_IN + CLIP_SAMPLES)
            if dry_n[LEAD_IN:].std() > 10 ** (-QUIET_DB / 20):
                return dry_n
        raise InputError(f"{path}: has no second of audible speech; give longer speech files.")

    def _nobody(self, kind: str, index: int, rng: np.random.Generator) -> npt.NDArray[np.float64]:
        if kind == PINK:
            return self._diffuse(index, rng)
        return (kind == WHITE) * NOISE_RMS * rng.standard_normal((self.num_microphones, CLIP_SAMPLES))

    def _diffuse(self, index: int, rng: np.random.Generator) -> npt.NDArray[np.float64]:
        """Pink noises through the late parts of many responses of one setting, independent of each other."""
        settings: dict[str, list[RoomResponse]] = defaultdict(list)
        for response in self.responses:
            settings[response.setting].append(response)
        large = [members for members in settings.values() if len(members) >= LEAST_DIFFUSE]
        if not large:
            raise InputError(
                f"{LABELS_NAME}: no setting has {LEAST_DIFFUSE} responses for diffuse noise; give more responses, or 0 "
                "for the third number of --num-clips."
            )
        members = large[index % len(large)]
        audio_mn = np.zeros((self.num_microphones, CLIP_SAMPLES))
        for member in rng.permutation(len(members))[:MOST_DIFFUSE]:
            late_mn = members[member].late_mn()
            pink_n = _pink(late_mn.shape[1] + CLIP_SAMPLES, rng)
            audio_mn += fftconvolve(pink_n[None], late_mn, axes=1)[:, late_mn.shape[1] :][:, :CLIP_SAMPLES]
        return _scaled(audio_mn)


def _apart(one: RoomResponse, other: RoomResponse) -> bool:
    return abs(float(wrap_angle(one.azimuth - other.azimuth))) >= np.deg2rad(MIN_SEPARATION_DEG) - 1e-9


def _scaled(audio_mn: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return PEAK * audio_mn / np.abs(audio_mn).max()


def _pink(num_samples: int, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    spectrum_f = np.fft.rfft(rng.standard_normal(num_samples))
    frequencies = np.fft.rfftfreq(num_samples, 1 / SAMPLE_RATE)
    pink_f = np.where(frequencies < LOWEST_PINK_HZ, 0, spectrum_f / np.sqrt(np.maximum(frequencies, LOWEST_PINK_HZ)))
    return np.fft.irfft(pink_f, num_samples)


def write_clips(folder: Path, clips: Sequence[RoomClip], array: MicrophoneArray) -> None:
    """Writes every clip as WAV (32-bit float), ``clips.csv`` (audio, azimuth_deg, kind) and the array.

    ``array.yaml`` has no channel map, since the files have the array's microphones in their order.

    Raises:
        OSError: the folder cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["audio,azimuth_deg,kind"]
    for made in clips:
        name = f"{made.clip.key}.wav"
        stream = io.BytesIO()
        soundfile.write(stream, made.clip.audio_mn.T, SAMPLE_RATE, format="WAV", subtype="FLOAT")
        write_atomically(folder / name, stream.getvalue())
        lines.append(f"{name},{' '.join(f'{degrees:.2f}' for degrees in np.rad2deg(made.azimuths))},{made.kind}")
    write_atomically(folder / "clips.csv", ("\n".join(lines) + "\n").encode())
    replace(array, channels=None).save(folder / "array.yaml")

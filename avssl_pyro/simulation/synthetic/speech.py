"""Synthetic speech: random syllables of a source-filter voice, without recordings."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import fft, signal

from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.simulation.speech import active_excerpt, normalize

HOP = 160
# First three formants of common vowels (Hz) for an adult male vocal tract; other tracts scale them.
VOWELS_HZ = np.array(
    [
        [730, 1090, 2440],
        [270, 2290, 3010],
        [300, 870, 2240],
        [530, 1840, 2480],
        [570, 840, 2410],
        [660, 1720, 2410],
        [490, 1350, 1690],
    ],
    dtype=np.float64,
)
HIGH_FORMANTS_HZ = np.array([3500.0, 4500.0, 5900.0])
BANDWIDTHS_HZ = np.array([70.0, 90.0, 130.0, 220.0, 300.0, 600.0])
GLOTTAL_POLES = (0.94, 0.6)
# Fricatives of running speech lie well below its vowels.
HISS_LEVEL = 0.25


@dataclass(frozen=True)
class Speaker:
    """Constant parameters of one voice.

    Args:
        pitch_hz: mean fundamental frequency, Hz.
        tract_scale: factor of the formant frequencies of an adult male vocal tract.
        syllables_per_s: rate of syllables, per second.
        breathiness: standard deviation of the noise added to the glottal pulses.
    """

    pitch_hz: float
    tract_scale: float
    syllables_per_s: float
    breathiness: float


def draw_speaker(rng: np.random.Generator) -> Speaker:
    """Draws a speaker; pitch rises with the formants, roughly from men over women to children."""
    size = float(rng.uniform())
    return Speaker(
        pitch_hz=95.0 * 2.5**size * float(rng.uniform(0.9, 1.1)),
        tract_scale=0.95 + 0.25 * size,
        syllables_per_s=float(rng.uniform(3.5, 5.5)),
        breathiness=float(rng.uniform(0.002, 0.01)),
    )


@dataclass(frozen=True)
class ProceduralSpeech:
    """Synthetic voices; every draw has another pitch, vocal tract and syllable rate.

    Syllables are vowel glides with a falling pitch, after a fricative, a burst or nothing, with short pauses between
    them. The energy is thus sparse in time and frequency, as the mixture model assumes of speech.
    """

    @property
    def name(self) -> str:
        return "procedural"

    def describe(self) -> str:
        return "speech-like voices made in code"

    def draw(self, rng: np.random.Generator, num_samples: int) -> npt.NDArray[np.float32]:
        speaker = draw_speaker(rng)
        speech_n = synthesize_speech(speaker, num_samples + SAMPLE_RATE // 4, rng)
        return normalize(active_excerpt(speech_n, num_samples, rng), "procedural speech")


def synthesize_speech(speaker: Speaker, num_samples: int, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Synthesizes syllables and pauses of one voice, (N,), 16 kHz, of any level, with N at least ``num_samples``."""
    num_frames = -(-num_samples // HOP)
    voiced_t = np.zeros(num_frames)
    hiss_t = np.zeros(num_frames)
    formants_th = np.tile(np.concatenate([VOWELS_HZ[6], HIGH_FORMANTS_HZ]), (num_frames, 1))
    hiss_hz = float(rng.uniform(3500, 5500))
    frame = int(rng.integers(0, 4))
    vowel = VOWELS_HZ[int(rng.integers(len(VOWELS_HZ)))]
    while frame < num_frames:
        length = max(8, int(SAMPLE_RATE / HOP / speaker.syllables_per_s * rng.uniform(0.7, 1.3)))
        onset = int(rng.integers(4, 9)) if rng.uniform() < 0.6 else 0
        loudness = float(rng.uniform(0.5, 1.0))
        if onset:
            is_burst = rng.uniform() < 0.4
            level = loudness * float(rng.uniform(0.3, 1.0))
            stop = min(frame + (2 if is_burst else onset), num_frames)
            hiss_t[frame:stop] = level * (np.exp(-np.arange(stop - frame)) if is_burst else 1.0)
        first, last = min(frame + onset, num_frames), min(frame + max(length, onset + 6), num_frames)
        target = VOWELS_HZ[int(rng.integers(len(VOWELS_HZ)))]
        glide_t = np.linspace(0.0, 1.0, last - first) ** 0.7
        formants_th[first:last, :3] = vowel + (target - vowel) * glide_t[:, None]
        voiced_t[first:last] = loudness * np.sin(np.pi * np.linspace(0.08, 0.97, last - first)) ** 0.5
        vowel = target
        frame = last + (int(rng.integers(10, 26)) if rng.uniform() < 0.12 else int(rng.integers(0, 4)))
    voiced_n = _voiced(speaker, voiced_t, formants_th * speaker.tract_scale, rng)
    consonants = HISS_LEVEL * float(np.std(voiced_n))
    return voiced_n + consonants * _hiss(hiss_t, hiss_hz, rng)


def _upsample(value_t: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.interp(np.arange(len(value_t) * HOP) / HOP - 0.5, np.arange(len(value_t)), value_t)


def _voiced(
    speaker: Speaker, level_t: npt.NDArray[np.float64], formants_th: npt.NDArray[np.float64], rng: np.random.Generator
) -> npt.NDArray[np.float64]:
    num_frames = len(level_t)
    wander_t = np.cumsum(rng.normal(0.0, 0.012, num_frames))
    declination_t = -0.08 * np.arange(num_frames) * HOP / SAMPLE_RATE
    accent_t = 0.15 * np.sin(2 * np.pi * (rng.uniform(1.0, 2.5) * np.arange(num_frames) * HOP / SAMPLE_RATE))
    pitch_n = _upsample(speaker.pitch_hz * np.exp(wander_t - wander_t.mean() + declination_t + accent_t))
    cycles_n = np.cumsum(pitch_n / SAMPLE_RATE)
    # A pulse at each whole cycle, split over two samples, so that periods are not rounded to whole samples.
    index = np.flatnonzero(np.diff(np.floor(cycles_n))) + 1
    late = (cycles_n[index] - np.floor(cycles_n[index])) * SAMPLE_RATE / pitch_n[index]
    excitation_n = np.zeros(len(cycles_n))
    excitation_n[index] += 1.0 - late
    excitation_n[index - 1] += late
    excitation_n += speaker.breathiness * rng.standard_normal(len(excitation_n))
    for pole in GLOTTAL_POLES:
        excitation_n = signal.lfilter([1.0 - pole], [1.0, -pole], excitation_n)
    excitation_n *= _upsample(level_t)
    # The lips radiate the derivative.
    return np.diff(_formant_filter(excitation_n, formants_th), prepend=0.0)


def _formant_filter(
    excitation_n: npt.NDArray[np.float64], formants_th: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Filters windows that overlap by half with a cascade of time-varying resonators."""
    half, num_samples = 2 * HOP, len(excitation_n)
    num_windows = -(-num_samples // half) + 1
    padded_n = np.pad(excitation_n, (half, (num_windows - 1) * half - num_samples + half))
    frames_tn = np.lib.stride_tricks.sliding_window_view(padded_n, 2 * half)[::half][:num_windows]
    # Zeros after each window hold the decay of the resonators.
    spectrum_tf = fft.rfft(frames_tn * signal.windows.hann(2 * half, sym=False), 3 * half, axis=1)
    delay_f = np.exp(-2j * np.pi * np.arange(spectrum_tf.shape[1]) / (3 * half))
    formants_th = formants_th[np.minimum(2 * np.arange(num_windows), len(formants_th) - 1)]
    radius_h = np.exp(-np.pi * BANDWIDTHS_HZ / SAMPLE_RATE)
    feedback_th = -2 * radius_h * np.cos(2 * np.pi * np.minimum(formants_th, 7600.0) / SAMPLE_RATE)
    for feedback_t, radius in zip(feedback_th.T[..., None], radius_h, strict=True):
        spectrum_tf *= (1 + feedback_t + radius**2) / (1 + delay_f * (feedback_t + radius**2 * delay_f))
    ringing_tn = fft.irfft(spectrum_tf, 3 * half, axis=1).reshape(num_windows, 3, half)
    filtered_tn = np.zeros((num_windows + 2, half))
    for part in range(3):
        filtered_tn[part : part + num_windows] += ringing_tn[:, part]
    return filtered_tn.ravel()[half : half + num_samples]


def _hiss(level_t: npt.NDArray[np.float64], centre_hz: float, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    num_samples = len(level_t) * HOP
    band = [centre_hz * 0.5, min(centre_hz * 1.5, 7800.0)]
    noise_n = signal.sosfilt(
        signal.butter(2, band, "bandpass", fs=SAMPLE_RATE, output="sos"), rng.standard_normal(num_samples)
    )
    hiss_n: npt.NDArray[np.float64] = noise_n / np.std(noise_n) * _upsample(level_t)
    return hiss_n

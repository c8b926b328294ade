"""Noise of a scene: a random mix of sensor noise, isotropic noise, and unseen point sources."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import fft

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.acoustics.diffuse_field import diffuse_field, noise_frequencies, noise_length
from avssl_pyro.validators import within

PINK_DB_PER_OCTAVE = -3.0
# Spectra are flat below this frequency, so that colored noise is not mostly rumble.
FLAT_BELOW_HZ = 100.0
# Frequencies between which the ripple of a spectrum is interpolated, an octave apart.
RIPPLE_HZ = SAMPLE_RATE / 2 / 2.0 ** np.arange(6, -1, -1)
MIN_POWER = 1e-10


@dataclass(frozen=True)
class NoiseConfig:
    """Distribution of the noise of scenes; every range is uniform.

    Args:
        snr_range_db: power of the talkers' mixture over that of sensor and isotropic noise together. Without talkers,
            the noise is alone.
        loud_snr_range_db: the same range for loud noise.
        loud_share: probability of loud noise.
        slope_range_db: slope of the isotropic noise's spectrum, decibels per octave.
        ripple_db: standard deviation of the isotropic noise's spectrum around that slope, per octave.
        num_points: possible numbers of unseen point sources, drawn uniformly; repeated numbers are drawn more often.
        point_level_range_db: power of a point source's reverberant image relative to the quietest talker. Scenes
            without talkers have none. Point sources have pink noise and no label.

    Raises:
        InputError: the limits of a range are exchanged, ``loud_share`` is no probability, or a number is negative.
    """

    snr_range_db: tuple[float, float] = (10.0, 30.0)
    loud_snr_range_db: tuple[float, float] = (0.0, 10.0)
    loud_share: float = 0.15
    slope_range_db: tuple[float, float] = (-6.0, 0.0)
    ripple_db: float = 3.0
    num_points: tuple[int, ...] = (0, 0, 0, 1, 2)
    point_level_range_db: tuple[float, float] = (-20.0, -10.0)

    def __post_init__(self) -> None:
        for name in ("snr_range_db", "loud_snr_range_db", "slope_range_db", "point_level_range_db"):
            low, high = getattr(self, name)
            if not low <= high:
                raise InputError(f"{name} is ({low:g}, {high:g}); the first number must not exceed the second.")
        within(0.0, 1.0).check(self, "loud_share")
        if min(self.num_points, default=-1) < 0:
            raise InputError(f"num_points is {self.num_points}; give one or more numbers of at least 0.")

    def draw(self, rng: np.random.Generator, *, with_talkers: bool) -> "Noise":
        """Draws the noise of one scene."""
        loud = rng.uniform() < self.loud_share
        snr_db = float(rng.uniform(*(self.loud_snr_range_db if loud else self.snr_range_db)))
        # This share is often near 0 and near 1: most noise is of one kind.
        diffuse_share = float(rng.beta(0.5, 0.5))
        sensor_slope_db = PINK_DB_PER_OCTAVE if rng.uniform() < 0.5 else 0.0
        slope_db = float(rng.uniform(*self.slope_range_db))
        ripple_db = tuple(rng.normal(0.0, self.ripple_db, len(RIPPLE_HZ)).tolist())
        num_points = int(rng.choice(self.num_points)) if with_talkers else 0
        levels_db = tuple(rng.uniform(*self.point_level_range_db, num_points).tolist())
        return Noise(snr_db, diffuse_share, sensor_slope_db, slope_db, ripple_db, levels_db)


@dataclass(frozen=True)
class Noise:
    """The noise of one scene.

    Args:
        snr_db: power of the talkers' mixture over that of sensor and isotropic noise.
        diffuse_share: share of isotropic noise in the power of both.
        sensor_slope_db: slope of the sensor noise's spectrum, decibels per octave; 0 is white, -3 pink.
        slope_db, ripple_db: slope of the isotropic noise's spectrum, and deviations from it at ``RIPPLE_HZ``.
        point_levels_db: level of each point source relative to the quietest talker.
    """

    snr_db: float
    diffuse_share: float
    sensor_slope_db: float
    slope_db: float
    ripple_db: tuple[float, ...]
    point_levels_db: tuple[float, ...]

    def to_dict(self) -> dict[str, Any]:
        """Returns plain JSON values: levels, share and slopes."""
        return {
            "snr_db": round(self.snr_db, 4),
            "diffuse_share": round(self.diffuse_share, 4),
            "sensor_slope_db": self.sensor_slope_db,
            "diffuse_slope_db": round(self.slope_db, 4),
            "point_levels_db": [round(level_db, 4) for level_db in self.point_levels_db],
        }

    def render(
        self, array: MicrophoneArray, num_samples: int, reference_power: float, rng: np.random.Generator
    ) -> npt.NDArray[np.float32]:
        """Renders sensor and isotropic noise, (M, N), float32.

        Args:
            array: M microphones, or channels.
            num_samples: number of samples at 16 kHz.
            reference_power: power of the talkers' mixture, or 1 without talkers.
            rng: random noise.
        """
        frequency_f = noise_frequencies(num_samples)
        sensor_mn = colored_noise(array.num_microphones, num_samples, self.sensor_slope_db, rng)
        diffuse_mn = diffuse_field(array).draw(
            num_samples, rng, spectrum_amplitude(frequency_f, self.slope_db, self.ripple_db)
        )
        power = reference_power / 10 ** (self.snr_db / 10)
        return scaled(sensor_mn, power * (1 - self.diffuse_share)) + scaled(diffuse_mn, power * self.diffuse_share)


def spectrum_amplitude(
    frequency_f: npt.NDArray[np.float64], slope_db: float, ripple_db: tuple[float, ...] = ()
) -> npt.NDArray[np.float64]:
    """Returns the amplitude at each frequency, (F,), of a spectrum with a slope in decibels per octave.

    Args:
        frequency_f: frequencies, hertz.
        slope_db: slope above 100 Hz, decibels per octave.
        ripple_db: deviations at ``RIPPLE_HZ``, decibels; none by default.
    """
    octave_f = np.log2(np.maximum(frequency_f, FLAT_BELOW_HZ))
    level_f = slope_db * (octave_f - np.log2(FLAT_BELOW_HZ))
    if ripple_db:
        level_f = level_f + np.interp(octave_f, np.log2(RIPPLE_HZ), ripple_db)
    amplitude_f: npt.NDArray[np.float64] = 10 ** (level_f / 20)
    return amplitude_f


def colored_noise(
    num_channels: int, num_samples: int, slope_db: float, rng: np.random.Generator
) -> npt.NDArray[np.float32]:
    """Draws Gaussian noise that is independent between channels, (M, N), float32, with a slope per octave."""
    if slope_db == 0.0:
        return rng.standard_normal((num_channels, num_samples), dtype=np.float32)
    frequency_f = noise_frequencies(num_samples)
    white_fmr = rng.standard_normal((num_channels, len(frequency_f), 2), dtype=np.float32)
    spectrum_mf = white_fmr.view(np.complex64)[..., 0] * spectrum_amplitude(frequency_f, slope_db).astype(np.float32)
    length = noise_length(num_samples)
    audio_mn: npt.NDArray[np.float32] = fft.irfft(spectrum_mf, length)[:, :num_samples]
    return audio_mn


def scaled(audio_mn: npt.NDArray[np.float32], power: float) -> npt.NDArray[np.float32]:
    """Scales audio to a power, averaged over channels; silence stays silent."""
    found = max(mean_power(audio_mn), MIN_POWER)
    return audio_mn * np.float32(np.sqrt(power / found))


def mean_power(audio_mn: npt.NDArray[np.float32]) -> float:
    """Returns the mean square over channels and samples."""
    return float(np.mean(np.square(audio_mn, dtype=np.float64)))

"""Two voices as an array in free field hears them, and the posterior of who knows where they are."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.localization.direct_level import DirectLevelRule
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource
from avssl_pyro.simulation.synthetic.speech import ProceduralSpeech

GRID = DirectionGrid(72)


def unit_vector(azimuth: float) -> npt.NDArray[np.float64]:
    return np.array([np.cos(azimuth), np.sin(azimuth), 0.0])


def heard(array: MicrophoneArray, dry_n: npt.NDArray[np.float32], azimuth: float) -> npt.NDArray[np.float64]:
    """A plane wave from ``azimuth`` at the microphones, (M, N); periodic, so exact."""
    frequencies = np.fft.rfftfreq(len(dry_n), 1 / 16_000)
    pressure_fm = array.steering.model(array).pressure(unit_vector(azimuth)[None], frequencies)[:, 0]
    return np.fft.irfft(np.fft.rfft(dry_n)[:, None] * pressure_fm, len(dry_n), axis=0).T


@dataclass(frozen=True)
class Scene:
    """Parts, mixture, and what is known of them."""

    images_smn: npt.NDArray[np.float64]
    audio_mn: npt.NDArray[np.float32]
    posterior: ClipPosterior
    sources: tuple[LocalizedSource, ...]


def scene(array: MicrophoneArray, azimuths_deg: tuple[float, ...], num_samples: int = 16_000, seed: int = 0) -> Scene:
    """Voices from these azimuths with white noise 30 dB below; one class looks at each, one everywhere."""
    rng = np.random.default_rng(seed)
    azimuths = np.deg2rad(azimuths_deg)
    images_smn = np.stack([heard(array, ProceduralSpeech().draw(rng, num_samples), azimuth) for azimuth in azimuths])
    images_smn *= 0.1
    noise_mn = 0.003 * rng.standard_normal(images_smn.shape[1:])
    offset_kd = np.remainder(GRID.azimuths - azimuths[:, None] + np.pi, 2 * np.pi) - np.pi
    weights_kd = np.exp(-0.5 * (offset_kd / np.deg2rad(4)) ** 2)
    weights_kd = np.concatenate([weights_kd, np.ones((1, GRID.num_directions))])
    levels_k = np.concatenate([0.9 - 0.01 * np.arange(len(azimuths)), [0.1]])
    posterior = ClipPosterior(
        direction_weights_kd=weights_kd / weights_kd.sum(-1, keepdims=True),
        mixing_levels_k=levels_k / levels_k.sum(),
        level_std_k=np.full(len(levels_k), 0.01),
        azimuth_std_k=np.full(len(levels_k), 0.03),
    )
    sources = DirectLevelRule().select(posterior, GRID)
    return Scene(images_smn, (images_smn.sum(0) + noise_mn).astype(np.float32), posterior, sources)

"""Sound from many points at an array: the source and its early reflections."""

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.steering_kinds import FreeFieldKind
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.simulation.acoustics.plane_waves import PlaneWaves
from avssl_pyro.simulation.acoustics.reverberation import FRACTIONAL_DELAY_TAPS, plane_wave_receiver


def sum_of_arrivals(
    array: MicrophoneArray, offset_kx: npt.NDArray[np.float64], amplitude_k: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float32], int]:
    """Sums sound from points at every microphone, (M, L), and returns the common delay in samples."""
    if array.steering == FreeFieldKind():
        return _at_points(array, offset_kx, amplitude_k), FRACTIONAL_DELAY_TAPS // 2
    distance_k = np.linalg.norm(offset_kx, axis=-1)
    waves = PlaneWaves(offset_kx / distance_k[:, None], distance_k / array.speed_of_sound, amplitude_k / distance_k)
    receiver = plane_wave_receiver(array)
    return receiver.responses(waves), receiver.half


def _at_points(
    array: MicrophoneArray, offset_kx: npt.NDArray[np.float64], amplitude_k: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Sums spherical waves at microphones in free field, with fractional delays by windowed sinc functions."""
    distance_mk = np.linalg.norm(array.positions[:, None] - offset_kx, axis=-1)
    delay_mk = distance_mk / array.speed_of_sound * SAMPLE_RATE
    whole_mk = np.floor(delay_mk + 0.5).astype(np.int64)
    half = FRACTIONAL_DELAY_TAPS // 2
    tap_l = np.arange(-half, half + 1)
    late_mkl = tap_l - (delay_mk - whole_mk)[..., None]
    window_mkl = 0.5 + 0.5 * np.cos(np.pi * late_mkl / (half + 1))
    impulse_mkl = np.sinc(late_mkl) * window_mkl * (amplitude_k / distance_mk)[..., None]
    place_mkl = whole_mk[..., None] + tap_l + half
    length = int(place_mkl.max()) + 1
    return np.stack(
        [
            np.bincount(place_kl.ravel(), impulse_kl.ravel(), minlength=length)
            for place_kl, impulse_kl in zip(place_mkl, impulse_mkl, strict=True)
        ]
    ).astype(np.float32)

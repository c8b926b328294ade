"""Room responses of arrays that scatter or encode sound, with every reflection as a plane wave.

The image method gives the direction, delay and gain of each reflection at the array's origin. The array's response to
plane waves maps them to the microphones. Two effects are neglected: the curvature of waves from near sources, and
sound that the array scatters back into the room.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.room_templates import fibonacci_sphere
from avssl_pyro.clip import SAMPLE_RATE

# Reflections use the nearest of these tabulated directions, at most 3 degrees away; the direct sound uses its own.
NUM_DIRECTIONS = 1500
# Delays are rounded to a quarter of a sample, alike at all microphones.
FRACTIONS = 4
# Margin on either side of the time of arrival at the origin, in addition to the travel time across the array.
MARGIN_SAMPLES = 32
# Responses fade out above this frequency; otherwise the ends of the filters would ring.
FADE_FROM_HZ = 7000.0


@dataclass(frozen=True)
class PlaneWaves:
    """K plane waves at the origin of an array; the first is the direct sound.

    Args:
        unit_vectors_kx: directions of arrival in the array's coordinates, (K, 3).
        delays_k: delays, (K,), seconds.
        gains_k: amplitudes, (K,).
    """

    unit_vectors_kx: npt.NDArray[np.float64]
    delays_k: npt.NDArray[np.float64]
    gains_k: npt.NDArray[np.float64]


@dataclass(frozen=True)
class PlaneWaveReceiver:
    """Impulse responses of an array to plane waves from any direction.

    Args:
        array: array of any kind with a response in all directions.

    Raises:
        InputError: the array has no response in all directions, see :meth:`.SteeringModel.pressure`.
    """

    array: MicrophoneArray

    @property
    def half(self) -> int:
        """Common delay of all responses in samples, as waves reach some microphones before the origin."""
        farthest_m = float(np.linalg.norm(self.array.positions, axis=-1).max(initial=0.0))
        return MARGIN_SAMPLES + math.ceil(farthest_m / self.array.speed_of_sound * SAMPLE_RATE)

    @cached_property
    def _directions(self) -> npt.NDArray[np.float64]:
        return fibonacci_sphere(NUM_DIRECTIONS)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._directions)

    @cached_property
    def _table_dvml(self) -> npt.NDArray[np.float32]:
        return self._impulses(self._directions)

    def _impulses(self, unit_vectors_dx: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
        """Computes impulse responses, (D, V, M, L); version v is late by v / V of a sample."""
        taps = 2 * self.half
        frequency_f = np.fft.rfftfreq(taps, 1 / SAMPLE_RATE).astype(np.float64)
        pressure_fdm = self.array.steering.model(self.array).pressure(unit_vectors_dx, frequency_f)
        fade_f = 0.5 + 0.5 * np.cos(
            np.pi * np.clip((frequency_f - FADE_FROM_HZ) / (SAMPLE_RATE / 2 - FADE_FROM_HZ), 0, 1)
        )
        late_v = self.half + np.arange(FRACTIONS) / FRACTIONS
        delay_vf = fade_f * np.exp(-2j * np.pi * frequency_f / SAMPLE_RATE * late_v[:, None])
        impulse_dvml = np.fft.irfft(pressure_fdm.transpose(1, 2, 0)[:, None] * delay_vf[:, None], taps)
        edge_l = np.minimum(np.arange(taps) + 0.5, taps - np.arange(taps) - 0.5) / (MARGIN_SAMPLES / 2)
        window_l = 0.5 - 0.5 * np.cos(np.pi * np.minimum(edge_l, 1.0))
        return (impulse_dvml * window_l).astype(np.float32)

    def impulse_responses(self, unit_vectors_dx: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
        """Computes the responses to waves from exact directions, (D, M, L), late by :attr:`half` samples."""
        return self._impulses(unit_vectors_dx)[:, 0]

    def responses(self, waves: PlaneWaves) -> npt.NDArray[np.float32]:
        """Sums the waves at every microphone, (M, L), float32, 16 kHz, late by :attr:`half` samples."""
        start_k, version_k = np.divmod(np.round(waves.delays_k * SAMPLE_RATE * FRACTIONS).astype(np.int64), FRACTIONS)
        _, nearest_k = self._tree.query(waves.unit_vectors_kx)
        taps = 2 * self.half
        length = int(start_k.max()) + taps
        response_ml = np.empty((self.array.num_microphones, length), dtype=np.float32)
        place_n = (start_k[1:, None] + np.arange(taps)).ravel()
        for m in range(self.array.num_microphones):
            response_kl = self._table_dvml[nearest_k[1:], version_k[1:], m] * waves.gains_k[1:, None]
            response_ml[m] = np.bincount(place_n, response_kl.ravel(), minlength=length)
        direct_ml = waves.gains_k[0] * self._impulses(waves.unit_vectors_kx[:1])[0, version_k[0]]
        response_ml[:, start_k[0] : start_k[0] + taps] += direct_ml
        return response_ml

"""Isotropic (diffuse) sound at an array: stationary noise, and the exponential tail of a room response.

Independent plane waves from all directions give the channels the covariance C(f), the mean of a(f) a(f)^H over the
sphere. Its square root times independent noise has the same distribution without rendering any wave. In free field
C(f) has the entries sinc(2 f d / c) for microphones d apart.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import ceil
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import fft

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.room_templates import fibonacci_sphere
from avssl_pyro.acoustics.steering_kinds import FreeFieldKind
from avssl_pyro.clip import SAMPLE_RATE

# Real in free field, complex otherwise.
Inexact = npt.NDArray[np.inexact[Any]]

# Directions of the average for arrays without a closed form.
NUM_DIRECTIONS = 600
# Frequencies of the square roots, 63 Hz apart or closer; between them the roots are interpolated.
MIN_FREQUENCIES = 129
FREQUENCIES_PER_PERIOD = 8
# Frequencies interpolated at once, which bounds the memory for arrays of many microphones.
BLOCK_FREQUENCIES = 2048


@dataclass(frozen=True)
class DiffuseField:
    """Isotropic sound at the microphones of an array.

    Args:
        array: array of any kind with a response in all directions.

    Raises:
        InputError: the array has no response in all directions, see :meth:`.SteeringModel.pressure`.
    """

    array: MicrophoneArray

    @cached_property
    def _root_kmm(self) -> Inexact:
        """Hermitian square roots of the covariance on a grid from 0 Hz to half the sampling rate, (K, M, M)."""
        value_km, vector_kmm = np.linalg.eigh(self._covariance_kmm())
        scaled_kmm = vector_kmm * np.sqrt(np.maximum(value_km, 0.0))[:, None, :]
        root_kmm = _sum_of_outer_products(scaled_kmm.swapaxes(-1, -2), vector_kmm.swapaxes(-1, -2))
        return root_kmm.astype(np.complex64 if np.iscomplexobj(root_kmm) else np.float32)

    def _covariance_kmm(self) -> Inexact:
        positions_mx = self.array.positions
        distance_mm = np.linalg.norm(positions_mx[:, None] - positions_mx, axis=-1)
        periods = SAMPLE_RATE / 2 * float(distance_mm.max(initial=0.0)) / self.array.speed_of_sound
        num_frequencies = max(MIN_FREQUENCIES, ceil(FREQUENCIES_PER_PERIOD * periods) + 1)
        frequency_k = np.linspace(0.0, SAMPLE_RATE / 2, num_frequencies)
        if self.array.steering == FreeFieldKind():
            covariance_kmm: npt.NDArray[np.float64] = np.sinc(
                2 * frequency_k[:, None, None] * distance_mm / self.array.speed_of_sound
            )
            return covariance_kmm
        a_kdm = self.array.steering.model(self.array).pressure(fibonacci_sphere(NUM_DIRECTIONS), frequency_k)
        return _sum_of_outer_products(a_kdm, a_kdm) / NUM_DIRECTIONS

    def draw(
        self, num_samples: int, rng: np.random.Generator, amplitude_f: npt.NDArray[np.floating] | None = None
    ) -> npt.NDArray[np.float32]:
        """Draws Gaussian noise, (M, N), float32; the pressure at the origin has unit variance without ``amplitude_f``.

        Args:
            num_samples: number of samples at 16 kHz.
            rng: random noise.
            amplitude_f: gain at each frequency of :func:`noise_frequencies`; 1 by default, for white noise.
        """
        length = noise_length(num_samples)
        num_frequencies = length // 2 + 1
        white_fmr = rng.standard_normal((num_frequencies, self.array.num_microphones, 2), dtype=np.float32)
        white_fmr *= np.float32(np.sqrt(length / 2))
        if amplitude_f is not None:
            white_fmr *= amplitude_f.astype(np.float32)[:, None, None]
        place_f = np.linspace(0.0, len(self._root_kmm) - 1, num_frequencies)
        spectrum_fm = np.empty(white_fmr.shape[:2], dtype=np.complex64)
        for first in range(0, num_frequencies, BLOCK_FREQUENCIES):
            block = slice(first, first + BLOCK_FREQUENCIES)
            spectrum_fm[block] = _product(self._roots_at(place_f[block]), white_fmr[block])
        audio_mn: npt.NDArray[np.float32] = fft.irfft(spectrum_fm.T, length)[:, :num_samples]
        return np.ascontiguousarray(audio_mn, dtype=np.float32)

    def _roots_at(self, place_f: npt.NDArray[np.float64]) -> Inexact:
        low_f = np.minimum(place_f.astype(np.int64), len(self._root_kmm) - 2)
        weight_f11 = (place_f - low_f).astype(np.float32)[:, None, None]
        low_fmm = self._root_kmm[low_f]
        return low_fmm + weight_f11 * (self._root_kmm[low_f + 1] - low_fmm)


def _sum_of_outer_products(a_kdm: Inexact, b_kdm: Inexact) -> Inexact:
    """Sums a b^H over d, (K, M, M); matrix products would have other bits with other numbers of threads."""
    summed_kmm: Inexact = np.einsum("kdm,kdn->kmn", a_kdm, b_kdm.conj())
    return summed_kmm


def _product(root_fmm: Inexact, white_fmr: npt.NDArray[np.float32]) -> npt.NDArray[np.complex64]:
    """Multiplies the roots with complex noise that is stored as real and imaginary parts, (F, M)."""
    # A complex root has real and imaginary parts itself; a real one acts on both parts alike.
    if np.iscomplexobj(root_fmm):
        return np.asarray((root_fmm @ white_fmr.view(np.complex64))[..., 0], dtype=np.complex64)
    mixed_fmr = np.ascontiguousarray(root_fmm @ white_fmr, dtype=np.float32)
    return mixed_fmr.view(np.complex64)[..., 0]


# Scenes of one array follow each other; the roots of other arrays than the latest few are computed again.
@lru_cache(maxsize=4)
def diffuse_field(array: MicrophoneArray) -> DiffuseField:
    """Returns the diffuse field of an array; its square roots are computed once."""
    return DiffuseField(array)


def noise_length(num_samples: int) -> int:
    """Returns the period of noise of ``num_samples``: the next length with a fast Fourier transform."""
    return int(fft.next_fast_len(num_samples, real=True))


def noise_frequencies(num_samples: int) -> npt.NDArray[np.float64]:
    """Returns the frequencies at which noise of ``num_samples`` is shaped, (F,), hertz."""
    return np.fft.rfftfreq(noise_length(num_samples), 1 / SAMPLE_RATE).astype(np.float64)

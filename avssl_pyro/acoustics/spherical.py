"""Responses of spherical arrays: microphones on a rigid sphere, and first-order ambisonics."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.special
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.steering import ArrayGeometry, normalized

# Below this value the first-order response is exact in double precision, while Hankel functions overflow.
TINY_KA = 1e-8
# i^(n - 1) for n modulo 4.
_TURNS = np.array([-1j, 1.0, 1j, -1.0])
# Order of the channels W, X, Y, Z, and the gains of W and of X, Y, Z.
CHANNEL_ORDERS = {"acn": "WYZX", "fuma": "WXYZ"}
NORMALIZATIONS = {"sn3d": (1.0, 1.0), "n3d": (1.0, 3**0.5), "maxn": (0.5**0.5, 1.0)}


def sphere_response(ka_f: npt.NDArray[np.float64], cosine: npt.NDArray[np.float64]) -> npt.NDArray[np.complex128]:
    """Computes the pressure on a rigid sphere in a plane wave, relative to the centre without the sphere.

    H = 1/(ka)^2 sum_n i^(n-1) (2n+1) P_n(cos gamma) / h_n'(ka), with the spherical Hankel function of the second kind,
    for waves exp(+j omega t) (e.g. Rafaely, Fundamentals of Spherical Array Processing). For small ka it is
    1 + 1.5 j ka cos gamma, with 1.5 times the phase of the free field.

    Args:
        ka_f: wave number times radius, (F,), not negative.
        cosine: cosine of the angle between microphone and source at the centre, any shape.

    Returns:
        Pressure, complex128, (F,) + the shape of ``cosine``.
    """
    # Terms decrease as (ka)^n / (2n - 1)!!; later ones are below rounding.
    n = np.arange(math.ceil(2 * ka_f.max(initial=0.0)) + 16)
    tiny_f = ka_f < TINY_KA
    ka_f1 = np.where(tiny_f, 1.0, ka_f)[:, None]
    with np.errstate(all="ignore"):
        slope_fn = scipy.special.spherical_jn(n, ka_f1, derivative=True) - 1j * scipy.special.spherical_yn(
            n, ka_f1, derivative=True
        )
        term_fn = _TURNS[n % 4] * (2 * n + 1) / (ka_f1**2 * slope_fn)
    # Where h_n' overflows, its term is zero.
    term_fn = np.where(np.isfinite(slope_fn) & np.isfinite(term_fn), term_fn, 0.0)
    legendre_n = scipy.special.eval_legendre(n.reshape(-1, *(1,) * cosine.ndim), cosine)
    response = np.tensordot(term_fn, legendre_n, axes=1)
    per_frequency = (-1, *(1,) * cosine.ndim)
    first_order = 1 + 1.5j * ka_f.reshape(per_frequency) * cosine
    return np.where(tiny_f.reshape(per_frequency), first_order, response)


class RigidSphere:
    """Steering model of microphones on a rigid sphere, which scatters plane waves.

    Args:
        array: microphones; each is projected onto the sphere along its direction from the centre.
        radius_m: radius of the sphere, metres.
        centre_m: centre of the sphere in the array's coordinates, metres.
    """

    def __init__(
        self, array: ArrayGeometry, radius_m: float, centre_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> None:
        self.array = array
        self.radius_m = radius_m
        self.centre_m = centre_m

    def __call__(self, grid: DirectionGrid, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        return normalized(self.pressure(grid.unit_vectors, frequencies_hz))

    def pressure(
        self, unit_vectors_dx: npt.NDArray[np.float64], frequencies_hz: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.complex128]:
        centre = np.array(self.centre_m)
        offset_mx = self.array.positions - centre
        outward_mx = offset_mx / np.linalg.norm(offset_mx, axis=-1, keepdims=True)
        wave_number_f = 2 * np.pi * frequencies_hz / self.array.speed_of_sound
        cosine_dm = unit_vectors_dx @ outward_mx.T
        phase_fd = wave_number_f[:, None] * (unit_vectors_dx @ centre)
        response_fdm = sphere_response(wave_number_f * self.radius_m, cosine_dm)
        pressure_fdm: npt.NDArray[np.complex128] = response_fdm * np.exp(1j * phase_fd)[..., None]
        return pressure_fdm


@dataclass(frozen=True)
class FirstOrderAmbisonics:
    """Steering model of first-order ambisonics: gains of the direction, equal at all frequencies.

    With ACN order and SN3D normalization (ambiX) the channels W, Y, Z, X have the gains [1, sin az cos el, sin el,
    cos az cos el].

    Args:
        order: channel order, ``acn`` (W, Y, Z, X) or ``fuma`` (W, X, Y, Z).
        normalization: normalization, ``sn3d``, ``n3d``, or ``maxn`` of FuMa files, whose W is 3 dB lower.
    """

    order: str = "acn"
    normalization: str = "sn3d"

    def __call__(self, grid: DirectionGrid, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        return normalized(self.pressure(grid.unit_vectors, frequencies_hz))

    def pressure(
        self, unit_vectors_dx: npt.NDArray[np.float64], frequencies_hz: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.complex128]:
        omni, dipole = NORMALIZATIONS[self.normalization]
        x_d, y_d, z_d = dipole * unit_vectors_dx.T
        gain_d = {"W": np.full(len(unit_vectors_dx), omni), "X": x_d, "Y": y_d, "Z": z_d}
        gain_dm = np.stack([gain_d[channel] for channel in CHANNEL_ORDERS[self.order]], axis=-1)
        return np.tile(gain_dm.astype(np.complex128), (len(frequencies_hz), 1, 1))

"""Spatial covariances of sound in a room: directions with reflections from above and below, and diffuse fields.

All have trace M at every frequency, as the templates of free field do, so that weights of all kinds compare.
"""

import math
from typing import Protocol

import numpy as np
import numpy.typing as npt
import torch
from attrs import field, frozen
from torch import Tensor

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.covariance import template_covariances
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.steering import normalized
from avssl_pyro.validators import at_least

# Elevation in degrees and share of power of what comes from an azimuth: the talker, floor and ceiling.
ELEVATION_SHARES = ((0.0, 0.8), (35.0, 0.1), (-35.0, 0.1))
HORIZON = ((0.0, 1.0),)


class DiffuseComponent(Protocol):
    """A kind of sound without direction, by its spatial covariance at an array."""

    def __call__(self, array: MicrophoneArray, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        """Covariance of trace M, complex128 (F, M, M)."""
        ...


@frozen
class SensorNoise:
    """Noise of the microphones themselves: the identity."""

    def __call__(self, array: MicrophoneArray, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        eye_mm = torch.eye(array.num_microphones, dtype=torch.complex128)
        return eye_mm.repeat(len(frequencies_hz), 1, 1)


@frozen
class IsotropicField:
    """Plane waves from everywhere alike: the mean of a a^H over the sphere, or over the horizon.

    The horizon stands for the sphere where the array's response is measured there alone.

    Args:
        num_points: points of the Fibonacci lattice, or of the horizon, that the mean is taken over.
    """

    num_points: int = field(default=600, validator=at_least(4))

    def __call__(self, array: MicrophoneArray, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        if array.steering.has_elevations:
            unit_dx = fibonacci_sphere(self.num_points)
            a_fdm = torch.from_numpy(array.steering.model(array).pressure(unit_dx, frequencies_hz))
        else:
            # Measured responses have an arbitrary scale in every direction, which steering vectors do not.
            a_fdm = array.steering_vectors(DirectionGrid(self.num_points), frequencies_hz)
        mean_fmm = torch.einsum("fdm,fdn->fmn", a_fdm, a_fdm.conj()) / self.num_points
        trace_f11 = mean_fmm.diagonal(dim1=-2, dim2=-1).real.sum(-1)[:, None, None]
        tiny = torch.finfo(trace_f11.dtype).tiny
        return mean_fmm * (array.num_microphones / trace_f11.clamp_min(tiny))


def elevated_templates(
    array: MicrophoneArray,
    grid: DirectionGrid,
    frequencies_hz: npt.NDArray[np.float64],
    shares: tuple[tuple[float, float], ...] | None = None,
) -> Tensor:
    """Templates G_fd = sum_e share_e a_fde a_fde^H of azimuths, each of trace M, complex128 (D, F, M, M).

    Args:
        array: array whose response is known at these elevations.
        grid: azimuths of the templates.
        frequencies_hz: frequencies, (F,).
        shares: elevation in degrees and share of each; shares sum to 1. By default :data:`ELEVATION_SHARES`, or the
            horizon alone where the array's response is measured there alone.

    Raises:
        InputError: the array's response is not known at these elevations.
    """
    if shares is None:
        shares = ELEVATION_SHARES if array.steering.has_elevations else HORIZON
    total_dfmm = torch.zeros(())
    for elevation_deg, share in shares:
        a_fdm = _steering_vectors(array, grid, frequencies_hz, math.radians(elevation_deg))
        total_dfmm = total_dfmm + share * template_covariances(a_fdm)
    return total_dfmm


def _steering_vectors(
    array: MicrophoneArray, grid: DirectionGrid, frequencies_hz: npt.NDArray[np.float64], elevation: float
) -> Tensor:
    if elevation == 0:
        return array.steering_vectors(grid, frequencies_hz)
    unit_dx = grid.unit_vectors * math.cos(elevation) + np.array([0.0, 0.0, math.sin(elevation)])
    return normalized(array.steering.model(array).pressure(unit_dx, frequencies_hz))


def fibonacci_sphere(num_points: int) -> npt.NDArray[np.float64]:
    """Unit vectors spread evenly over the sphere, (N, 3)."""
    index_n = np.arange(num_points)
    z_n = 1 - (2 * index_n + 1) / num_points
    azimuth_n = np.pi * (3 - np.sqrt(5)) * index_n
    flat_n = np.sqrt(1 - z_n**2)
    return np.stack([flat_n * np.cos(azimuth_n), flat_n * np.sin(azimuth_n), z_n], axis=-1)

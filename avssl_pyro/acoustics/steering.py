"""Steering vectors: response of each microphone to a plane wave from each candidate direction."""

from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid

# Power relative to the loudest direction below which a response counts as zero.
MIN_RELATIVE_POWER = 1e-10


class SteeringModel(Protocol):
    """Model of an array's response, for example free field or measured transfer functions."""

    def __call__(self, grid: DirectionGrid, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        """Computes steering vectors a_fd, complex128 (F, D, M), of squared norm M; see :func:`normalized`."""
        ...

    def pressure(
        self, unit_vectors_dx: npt.NDArray[np.float64], frequencies_hz: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.complex128]:
        """Computes the responses to plane waves from unit vectors (D, 3), complex128 (F, D, M), not normalized.

        Responses are relative to the pressure at the array's origin without the array. Rooms are simulated with them.

        Raises:
            InputError: the model has no response in some directions.
        """
        ...


class ArrayGeometry(Protocol):
    """Interface of an array that a steering model needs; :class:`.MicrophoneArray` implements it."""

    @property
    def name(self) -> str: ...

    @property
    def positions(self) -> npt.NDArray[np.float64]:
        """Positions, (M, 3), metres."""
        ...

    @property
    def speed_of_sound(self) -> float: ...


class SteeringKind(Protocol):
    """Kind and parameters of a steering model in an array's file; compared by value."""

    kind: ClassVar[str]
    """The value of ``kind`` in the file."""
    has_delays: ClassVar[bool]
    """True if directions differ in the phase between channels, False if in level only."""
    gains_are_free: ClassVar[bool]
    """True if the model does not fix gains and signs of the channels, which are then the device's own."""
    has_elevations: ClassVar[bool]
    """True if responses are known above and below the horizon."""

    @property
    def num_microphones(self) -> int | None:
        """M if the kind determines it; None if there is one microphone per position."""
        ...

    @property
    def description(self) -> str:
        """Predicate in messages, e.g. ``in free field``."""
        ...

    def check(self, array: ArrayGeometry) -> None:
        """Raises InputError if the positions of the array do not fit this kind."""
        ...

    def model(self, array: ArrayGeometry) -> SteeringModel:
        """Returns the steering model of an array."""
        ...

    def to_dict(self) -> dict[str, Any]:
        """Returns the value of ``steering`` in the file."""
        ...


def normalized(a_fdm: npt.NDArray[np.complex128]) -> Tensor:
    """Scales steering vectors to squared norm M, as in free field, complex128 (F, D, M).

    The mean squared modulus per microphone becomes 1 at every frequency and in every direction; differences between
    microphones stay. The model loses nothing, as the power spectral density absorbs the scale of a source. The diffuse
    power, which is relative to the weights, then has the same meaning at every frequency. No direction explains more
    sound only because the array (or the measuring loudspeaker) is louder there.

    A direction without response at a frequency, such as a measurement at 0 Hz, gets ones at all microphones.
    """
    power_fd1 = np.mean(np.abs(a_fdm) ** 2, axis=-1, keepdims=True)
    audible_fd1 = power_fd1 > MIN_RELATIVE_POWER * power_fd1.max(initial=0.0)
    scaled_fdm = a_fdm / np.sqrt(np.where(audible_fd1, power_fd1, 1.0))
    return torch.from_numpy(np.where(audible_fd1, scaled_fdm, 1.0 + 0j))


class FreeField:
    """Steering model of microphones in free field (the paper's Sec. IV-A).

    A wave from unit vector u reaches a microphone at p earlier by p.u/c, with phase ``exp(+j 2 pi f p.u / c)``.
    """

    def __init__(self, array: ArrayGeometry) -> None:
        self.array = array

    def __call__(self, grid: DirectionGrid, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        return torch.from_numpy(self.pressure(grid.unit_vectors, frequencies_hz))

    def pressure(
        self, unit_vectors_dx: npt.NDArray[np.float64], frequencies_hz: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.complex128]:
        lead_dm = unit_vectors_dx @ self.array.positions.T / self.array.speed_of_sound
        phase_fdm = 2 * np.pi * frequencies_hz[:, None, None] * lead_dm
        return np.exp(1j * phase_fdm)

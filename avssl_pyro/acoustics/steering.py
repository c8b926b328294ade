"""Steering vectors: what each microphone hears of a source in each candidate direction."""

from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid

# A direction heard this far below the loudest, in power, is not heard at all.
UNHEARD = 1e-10


class SteeringModel(Protocol):
    """Anything that knows the response of an array; free field is one, measured transfer functions are another."""

    def __call__(self, grid: DirectionGrid, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        """Steering vectors a_fd, complex128 (F, D, M), each of squared norm M; see :func:`normalized`."""
        ...

    def pressure(
        self, unit_vectors_dx: npt.NDArray[np.float64], frequencies_hz: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.complex128]:
        """What is recorded of plane waves from any directions, (D, 3), as it is: complex128 (F, D, M).

        Relative to the pressure at the array's origin if nothing stood there; what rooms are simulated with.

        Raises:
            InputError: the response is not known in all directions.
        """
        ...


class ArrayGeometry(Protocol):
    """What a steering model asks of an array; :class:`avssl_pyro.acoustics.array.MicrophoneArray` has it."""

    @property
    def name(self) -> str: ...

    @property
    def positions(self) -> npt.NDArray[np.float64]:
        """(M, 3), metres."""
        ...

    @property
    def speed_of_sound(self) -> float: ...


class SteeringKind(Protocol):
    """How an array's file says by which steering model the array hears; compared by value."""

    kind: ClassVar[str]
    """The value of ``kind`` in the file."""
    has_delays: ClassVar[bool]
    """Whether directions differ in the phase between channels, and not in level alone."""

    @property
    def num_microphones(self) -> int | None:
        """M where the kind decides it; None where there is one per position."""
        ...

    @property
    def description(self) -> str:
        """How messages put it, e.g. ``in free field``."""
        ...

    def check(self, array: ArrayGeometry) -> None:
        """Raises InputError, naming the array, when its positions do not go with this kind."""
        ...

    def model(self, array: ArrayGeometry) -> SteeringModel:
        """The steering model of an array of this kind."""
        ...

    def to_dict(self) -> dict[str, Any]:
        """What stands under ``steering:`` in the file."""
        ...


def normalized(a_fdm: npt.NDArray[np.complex128]) -> Tensor:
    """Steering vectors scaled to squared norm M, as those of free field have, complex128 (F, D, M).

    The mean squared modulus per microphone is thus 1 at every frequency and in every direction, while levels and
    delays between the microphones stay. The power spectral density absorbs the scale of a source, so nothing is lost,
    and two things are won: the diffuse power, which is relative to the weights, means the same at every frequency, and
    no direction explains more sound only because the array (or the loudspeaker that measured it) is louder there.

    A direction that is not heard at all at a frequency, such as a measurement at 0 Hz, has every microphone alike.
    """
    power_fd1 = np.mean(np.abs(a_fdm) ** 2, axis=-1, keepdims=True)
    heard_fd1 = power_fd1 > UNHEARD * power_fd1.max(initial=0.0)
    scaled_fdm = a_fdm / np.sqrt(np.where(heard_fd1, power_fd1, 1.0))
    return torch.from_numpy(np.where(heard_fd1, scaled_fdm, 1.0 + 0j))


class FreeField:
    """Plane waves that pass the microphones undisturbed (the paper's Sec. IV-A).

    A wave from unit vector u reaches a microphone at p early by p.u/c, so its phase is ``exp(+j 2 pi f p.u / c)``.
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

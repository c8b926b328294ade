"""Steering vectors: what each microphone hears of a source in each candidate direction."""

from typing import Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid


class SteeringModel(Protocol):
    """Anything that knows the response of an array; free field is one, measured transfer functions are another."""

    def __call__(self, grid: DirectionGrid, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        """Steering vectors a_fd, complex128 (F, D, M)."""
        ...


class FreeField:
    """Plane waves that pass the microphones undisturbed (the paper's Sec. IV-A).

    A wave from unit vector u reaches a microphone at p early by p.u/c, so its phase is ``exp(+j 2 pi f p.u / c)``.
    """

    def __init__(self, array: MicrophoneArray) -> None:
        self.array = array

    def __call__(self, grid: DirectionGrid, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        lead_dm = grid.unit_vectors @ self.array.positions.T / self.array.speed_of_sound
        phase_fdm = 2 * np.pi * frequencies_hz[:, None, None] * lead_dm
        return torch.from_numpy(np.exp(1j * phase_fdm))

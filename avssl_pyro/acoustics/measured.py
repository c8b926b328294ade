"""Steering vectors from responses of the array, measured in many horizontal directions."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.steering import normalized
from avssl_pyro.errors import InputError

# With a wider gap the phase of an array of 20 cm changes by more than half a turn between directions at 8 kHz.
MAX_GAP_DEG = 10.0
GAP_TOLERANCE_DEG = 1e-3


@dataclass(frozen=True, eq=False)
class MeasuredResponses:
    """Responses of M microphones to a source in each of D' horizontal directions.

    Level and phase are interpolated linearly between measured directions and between measured frequencies. A delay
    common to all microphones is removed first, as it depends on the distance of the loudspeaker. Below the lowest
    measured frequency its response is used.

    Args:
        azimuths_d: measured azimuths, (D',), radians in [-pi, pi), increasing.
        frequencies_n: measured frequencies, (N,), Hz, increasing.
        response_dmn: responses, complex (D', M, N), with a common but unknown scale and delay in each direction.

    Raises:
        InputError: neighbouring directions are more than 10 degrees apart.
    """

    azimuths_d: npt.NDArray[np.float64]
    frequencies_n: npt.NDArray[np.float64]
    response_dmn: npt.NDArray[np.complexfloating[Any, Any]]

    def __post_init__(self) -> None:
        start, stop = widest_gap_deg(self.azimuths_d)
        if stop - start > MAX_GAP_DEG + GAP_TOLERANCE_DEG:
            end = stop - 360 if stop >= 180 else stop
            raise InputError(
                f"no response was measured on the horizontal plane between azimuth {start:.4g} and {end:.4g} degrees, "
                f"a gap of {stop - start:.4g}; give responses at most {MAX_GAP_DEG:g} degrees apart."
            )

    @property
    def num_microphones(self) -> int:
        return self.response_dmn.shape[1]

    def __call__(self, grid: DirectionGrid, frequencies_hz: npt.NDArray[np.float64]) -> Tensor:
        """Computes steering vectors; raises InputError for a frequency above the measured ones."""
        if frequencies_hz.max(initial=0.0) > self.frequencies_n[-1]:
            raise InputError(
                f"the measured responses end at {self.frequencies_n[-1]:g} Hz, but steering vectors up to "
                f"{frequencies_hz.max():g} Hz are needed; lower the STFT's high_hz."
            )
        response_dmf = self._at_frequencies(frequencies_hz)
        return normalized(self._at_azimuths(response_dmf, grid.azimuths).transpose(2, 0, 1))

    def pressure(
        self,
        unit_vectors_dx: npt.NDArray[np.float64],  # noqa: ARG002
        frequencies_hz: npt.NDArray[np.float64],  # noqa: ARG002
    ) -> npt.NDArray[np.complex128]:
        """Raises InputError, as responses from above and below were not measured."""
        raise InputError(
            "measured responses are of horizontal directions only, but a room reflects sound from above and below; "
            "give recordings of this array instead."
        )

    def _at_frequencies(self, frequencies_hz: npt.NDArray[np.float64]) -> npt.NDArray[np.complex128]:
        last = len(self.frequencies_n) - 1
        place_f = np.interp(frequencies_hz, self.frequencies_n, np.arange(last + 1.0))
        below_f = np.minimum(place_f.astype(np.int64), max(last - 1, 0))
        above_f = np.minimum(below_f + 1, last)
        return _between(self.response_dmn[..., below_f], self.response_dmn[..., above_f], place_f - below_f)

    def _at_azimuths(
        self, response_dmf: npt.NDArray[np.complex128], azimuths: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.complex128]:
        count = len(self.azimuths_d)
        # One more direction at either end, so that every azimuth has two neighbours.
        around = np.concatenate([self.azimuths_d[-1:] - 2 * np.pi, self.azimuths_d, self.azimuths_d[:1] + 2 * np.pi])
        place = np.interp(azimuths, around, np.arange(count + 2.0))
        before = np.minimum(place.astype(np.int64), count)
        share_d11 = (place - before)[:, None, None]
        return _between(response_dmf[(before - 1) % count], response_dmf[before % count], share_d11)


def widest_gap_deg(azimuths_d: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Returns start and stop, degrees, of the widest gap between neighbouring azimuths (radians, increasing)."""
    start_d = np.rad2deg(azimuths_d)
    stop_d = np.append(start_d[1:], start_d[:1] + 360.0)
    widest = int((stop_d - start_d).argmax())
    return float(start_d[widest]), float(stop_d[widest])


def _between(
    first_dmf: npt.NDArray[np.complexfloating[Any, Any]],
    second_dmf: npt.NDArray[np.complexfloating[Any, Any]],
    share: npt.NDArray[np.float64],
) -> npt.NDArray[np.complex128]:
    """Interpolates level and phase linearly between two responses, except for a common phase."""
    common_d1f = np.sum(first_dmf.conj() * second_dmf, axis=1, keepdims=True)
    turn_dmf = np.angle(first_dmf.conj() * second_dmf * common_d1f.conj())
    level_dmf = (1 - share) * np.abs(first_dmf) + share * np.abs(second_dmf)
    between_dmf: npt.NDArray[np.complex128] = level_dmf * np.exp(1j * (np.angle(first_dmf) + share * turn_dmf))
    return between_dmf

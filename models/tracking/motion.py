"""What is assumed of a talker before anything is heard: how it moves, pauses, comes and goes."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from avssl_pyro.acoustics.grid import DirectionGrid

# Motions: clockwise, at rest, counter-clockwise; their sign times the speed is the drift of the azimuth.
MOTION_SIGNS = (-1.0, 0.0, 1.0)
# A step without spread is one of this spread, radians.
LEAST_STD = 1e-15


@dataclass(frozen=True)
class TrackTables:
    """The probabilities of one step of a track; a silent or sounding source is a, its motion h, its direction d.

    Args:
        birth: that a source begins in a given window.
        survive: that it is still there a window later.
        activity_aa: from silent (0) or sounding (1) to either, (2, 2).
        motion_hh: from one motion to another, (3, 3).
        move_hde: under motion h, from direction d to direction e, (3, D, D).
    """

    birth: float
    survive: float
    activity_aa: npt.NDArray[np.float64]
    motion_hh: npt.NDArray[np.float64]
    move_hde: npt.NDArray[np.float64]


@dataclass(frozen=True)
class TrackPrior:
    """A talker who rests or walks around the array, speaks and pauses. Rates are per second, angles in radians.

    Args:
        speed: of a walking source.
        speed_std: spread of the speed, of one at rest as well.
        turn_rate: of stopping, starting to walk and turning back.
        pause_rate: of falling silent; its inverse is the mean length of an utterance.
        resume_rate: of speaking again; its inverse is the mean length of a pause.
        birth_rate: of new sources.
        leave_rate: of a source's end.
    """

    speed: float = float(np.deg2rad(12.0))
    speed_std: float = float(np.deg2rad(4.0))
    turn_rate: float = 0.5
    pause_rate: float = 0.5
    resume_rate: float = 1.4
    birth_rate: float = 0.02
    leave_rate: float = 0.05

    def tables(self, grid: DirectionGrid, step_s: float) -> TrackTables:
        """The transition probabilities over ``step_s`` seconds; at most one change of each kind in a step."""
        pause, resume, turn = (
            1 - np.exp(-rate * step_s) for rate in (self.pause_rate, self.resume_rate, self.turn_rate)
        )
        motions = len(MOTION_SIGNS)
        motion_hh = np.full((motions, motions), turn / (motions - 1))
        np.fill_diagonal(motion_hh, 1 - turn)
        return TrackTables(
            birth=float(1 - np.exp(-self.birth_rate * step_s)),
            survive=float(np.exp(-self.leave_rate * step_s)),
            activity_aa=np.array([[1 - resume, resume], [pause, 1 - pause]]),
            motion_hh=motion_hh,
            move_hde=np.stack(
                [move_kernel(grid, sign * self.speed * step_s, self.speed_std * step_s) for sign in MOTION_SIGNS]
            ),
        )


def move_kernel(grid: DirectionGrid, drift: float, std: float) -> npt.NDArray[np.float64]:
    """Probabilities of moving from direction d to e, (D, D), for a wrapped Gaussian step of azimuth, radians.

    The step is shared between the two grid points beside it in proportion (linear interpolation), so its mean is kept
    and a step much shorter than the grid's spacing still crosses into the next cell as often as it should.
    """
    d = grid.num_directions
    # The azimuth falls as the index rises; turns to either side cover every step that is not astronomically rare.
    offset_nj = -grid.spacing * (np.arange(d, dtype=np.float64) + d * np.arange(-2.0, 3.0)[:, None])
    hat_nj = (
        _mean_distance(offset_nj + grid.spacing - drift, std)
        - 2 * _mean_distance(offset_nj - drift, std)
        + _mean_distance(offset_nj - grid.spacing - drift, std)
    ) / (2 * grid.spacing)
    step_j = np.maximum(hat_nj.sum(0), 0.0)
    step_j /= step_j.sum()
    index_d = np.arange(d)
    kernel_de: npt.NDArray[np.float64] = step_j[(index_d[None, :] - index_d[:, None]) % d]
    return kernel_de


def _mean_distance(point: npt.NDArray[np.float64], std: float) -> npt.NDArray[np.float64]:
    """E |X - point| of a Gaussian X with mean 0."""
    z = point / (np.sqrt(2) * max(std, LEAST_STD))
    mean: npt.NDArray[np.float64] = point * erf(z) + std * np.sqrt(2 / np.pi) * np.exp(-(z**2))
    return mean

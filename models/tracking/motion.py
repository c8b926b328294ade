"""Prior of a talker's motion, pauses, birth and death."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from avssl_pyro.acoustics.grid import DirectionGrid

# Motions: clockwise, at rest, counter-clockwise; their sign times the speed is the drift of the azimuth.
MOTION_SIGNS = (-1.0, 0.0, 1.0)
# Least spread of a step in radians, which avoids a division by zero.
LEAST_STD = 1e-15


@dataclass(frozen=True)
class TrackTables:
    """Transition probabilities of a track over activity a, motion h and direction d.

    Args:
        birth: probability that a source begins in a given window.
        survive: probability that a source still exists one window later.
        activity_aa: probabilities from silent (0) or sounding (1) to either, (2, 2).
        motion_hh: probabilities from one motion to another, (3, 3).
        move_hde: probabilities from direction d to direction e under motion h, (3, D, D).
    """

    birth: float
    survive: float
    activity_aa: npt.NDArray[np.float64]
    motion_hh: npt.NDArray[np.float64]
    move_hde: npt.NDArray[np.float64]


@dataclass(frozen=True)
class TrackPrior:
    """Prior of a talker who rests or walks around the array, speaks and pauses.

    Args:
        speed: angular speed of a walking talker in radians per second.
        speed_std: standard deviation of the angular speed in radians per second, also at rest.
        turn_rate: rate per second of stopping, starting to walk and turning back.
        pause_rate: rate per second of falling silent; its inverse is the mean length of an utterance.
        resume_rate: rate per second of resuming speech; its inverse is the mean length of a pause.
        birth_rate: rate per second of new sources.
        leave_rate: rate per second at which a source ends.
    """

    speed: float = float(np.deg2rad(12.0))
    speed_std: float = float(np.deg2rad(4.0))
    turn_rate: float = 0.5
    pause_rate: float = 0.5
    resume_rate: float = 1.4
    birth_rate: float = 0.02
    leave_rate: float = 0.05

    def tables(self, grid: DirectionGrid, step_s: float) -> TrackTables:
        """Returns transition probabilities with at most one change of a kind per step.

        Args:
            grid: directions of the track.
            step_s: time between windows in seconds.
        """
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
    """Returns transition probabilities from direction d to e, (D, D).

    The step is Gaussian, wraps around the circle and is interpolated linearly between the nearest grid points. This
    preserves its mean, also for steps much shorter than the grid's spacing.

    Args:
        grid: directions d and e.
        drift: mean of the step of azimuth in radians.
        std: standard deviation of the step in radians.
    """
    d = grid.num_directions
    # The azimuth falls as the index rises. Two turns to either side cover every step of noticeable probability.
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
    """Returns E |X - point| of a Gaussian X with mean 0."""
    z = point / (np.sqrt(2) * max(std, LEAST_STD))
    mean: npt.NDArray[np.float64] = point * erf(z) + std * np.sqrt(2 / np.pi) * np.exp(-(z**2))
    return mean

"""Forward-backward algorithm for one track, as array products.

The model is the HMM of :mod:`avssl_pyro.models.tracking.hmm`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.models.tracking.motion import MOTION_SIGNS, TrackTables

Array = npt.NDArray[np.float64]
SILENT, SOUNDING = 0, 1


@dataclass(frozen=True)
class TrackState:
    """Distribution over the states of a track, or a message between windows.

    Args:
        present_had: weights of a source with motion h, silent or sounding a, in direction d, (3, 2, D).
        absent: weight of the state without a source.
    """

    present_had: Array
    absent: float

    @property
    def presence(self) -> float:
        """Probability that the source exists."""
        return float(self.present_had.sum())

    @property
    def sounding_d(self) -> Array:
        """Probability that the source sounds in each direction, (D,)."""
        sounding_d: Array = self.present_had[:, SOUNDING].sum(0)
        return sounding_d

    def direction(self, grid: DirectionGrid) -> tuple[float, float]:
        """Returns mean and standard deviation of the azimuth in radians, given presence."""
        weight_d = self.present_had.sum((0, 1))
        mean = complex(weight_d @ np.exp(1j * grid.azimuths)) / max(float(weight_d.sum()), np.finfo(np.float64).tiny)
        # Circular variance, plus the variance of the position within a cell.
        variance = -2 * np.log(min(max(abs(mean), 1e-9), 1.0)) + grid.spacing**2 / 12
        return float(np.angle(mean)), float(np.sqrt(variance))

    @property
    def total(self) -> float:
        return float(self.present_had.sum()) + self.absent

    def scaled(self, factor: float) -> "TrackState":
        return TrackState(self.present_had * factor, self.absent * factor)

    def times(self, other: "TrackState") -> "TrackState":
        """Returns the normalized product of both."""
        product = TrackState(self.present_had * other.present_had, self.absent * other.absent)
        return product.scaled(1 / product.total)


def initial(birth: float, num_directions: int) -> TrackState:
    """Returns the state before any detection, uniform over directions.

    Args:
        birth: probability that a sounding source exists.
        num_directions: number of directions D.
    """
    present_had = np.zeros((len(MOTION_SIGNS), 2, num_directions))
    present_had[:, SOUNDING] = birth / (len(MOTION_SIGNS) * num_directions)
    return TrackState(present_had, 1 - birth)


def predict(belief: TrackState, tables: TrackTables) -> TrackState:
    """Returns the predicted state one step later."""
    _, _, d = belief.present_had.shape
    active_had = tables.activity_aa.T @ belief.present_had
    turned_had = (tables.motion_hh.T @ active_had.reshape(len(MOTION_SIGNS), -1)).reshape(-1, 2, d)
    return TrackState(
        tables.survive * (turned_had @ tables.move_hde),
        belief.absent + (1 - tables.survive) * float(belief.present_had.sum()),
    )


def retrodict(message: TrackState, tables: TrackTables) -> TrackState:
    """Returns the backward message of a window; the transpose of :func:`predict`.

    Args:
        message: backward message of the next window.
        tables: transition probabilities to the next window.
    """
    _, _, d = message.present_had.shape
    moved_had = message.present_had @ tables.move_hde.transpose(0, 2, 1)
    turned_had = (tables.motion_hh @ moved_had.reshape(len(MOTION_SIGNS), -1)).reshape(-1, 2, d)
    stays_had = tables.activity_aa @ turned_had
    return TrackState(tables.survive * stays_had + (1 - tables.survive) * message.absent, message.absent)


def weigh(belief: TrackState, ratio_d: Array) -> TrackState:
    """Returns the state multiplied by a window's likelihood ratio, (D,)."""
    present_had = belief.present_had.copy()
    present_had[:, SOUNDING] *= ratio_d
    return TrackState(present_had, belief.absent)


@dataclass(frozen=True)
class Step:
    """One window of the forward pass.

    Args:
        filtered: state given the windows so far.
        ratio_d: likelihood ratio of the detections, (D,).
        tables: transition probabilities of the step to this window.
        norm: probability of the detections given the windows before, relative to clutter.
    """

    filtered: TrackState
    ratio_d: Array
    tables: TrackTables
    norm: float


def observe(predicted: TrackState, ratio_d: Array, tables: TrackTables) -> Step:
    """Filters one window by the forward algorithm.

    Args:
        predicted: result of :func:`initial` or :func:`predict`.
        ratio_d: likelihood ratio of the window's detections, (D,).
        tables: transition probabilities that gave ``predicted``.
    """
    weighed = weigh(predicted, ratio_d)
    return Step(weighed.scaled(1 / weighed.total), ratio_d, tables, weighed.total)


def log_evidence(steps: Sequence[Step]) -> float:
    """Returns the log probability of all detections relative to clutter alone."""
    return float(sum(np.log(step.norm) for step in steps))


def smooth(steps: Sequence[Step]) -> Iterator[TrackState]:
    """Yields the states given all windows, from the last window to the first."""
    belief = steps[-1].filtered
    message = TrackState(np.ones_like(belief.present_had), 1.0)
    yield belief
    for step, after in zip(reversed(steps[:-1]), reversed(steps[1:]), strict=True):
        message = retrodict(weigh(message, after.ratio_d), after.tables).scaled(1 / after.norm)
        yield step.filtered.times(message)

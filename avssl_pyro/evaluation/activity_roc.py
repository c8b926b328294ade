"""Detection of talkers by direct level: levels of people, their ROC curve and the area below it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import rankdata

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.evaluation.matching import angular_errors
from avssl_pyro.localization.direct_level import DirectLevelRule
from avssl_pyro.localization.posterior import ClipPosterior

# A person with no source class this close has level 0.
WITHIN_DEG = 15.0


@dataclass(frozen=True)
class RocCurve:
    """A receiver operating characteristic.

    Args:
        false_alarms_p, hits_p: shares of silent and of talking people at or above a threshold that falls along p.
        area: area below the curve: probability that a random talker has a higher level than a random silent person.
    """

    false_alarms_p: npt.NDArray[np.float64]
    hits_p: npt.NDArray[np.float64]
    area: float


def levels_of(
    people: npt.ArrayLike,
    posterior: ClipPosterior,
    grid: DirectionGrid,
    within: float = float(np.deg2rad(WITHIN_DEG)),
) -> npt.NDArray[np.float64]:
    """Direct level of the source nearest to each person, close classes merged, (R,), or 0 if none is near.

    Args:
        people: azimuths, (R,), radians.
        posterior, grid: posterior of a clip and its directions; classes alike in all directions are left out.
        within: largest angle between a person and its class, radians.
    """
    pointed = DirectLevelRule(least=0.0).select(posterior, grid)
    error_re = angular_errors(people, [source.azimuth for source in pointed])
    if not pointed:
        return np.zeros(len(error_re))
    level_e = np.array([source.direct_level for source in pointed])
    return np.where(error_re.min(axis=1) <= within, level_e[error_re.argmin(axis=1)], 0.0)


def roc_curve(talking: npt.ArrayLike, silent: npt.ArrayLike) -> RocCurve | None:
    """Curve of detecting talkers by a threshold on their levels; None without talkers or without silent people."""
    talking_t, silent_s = np.asarray(talking, dtype=np.float64), np.asarray(silent, dtype=np.float64)
    if not (talking_t.size and silent_s.size):
        return None
    thresholds = np.unique(np.concatenate([talking_t, silent_s]))[::-1]

    def share_above(level_n: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        at_least = len(level_n) - np.searchsorted(np.sort(level_n), thresholds, side="left")
        return np.concatenate([[0.0], at_least / len(level_n)])

    # Mann and Whitney's statistic.
    rank_sum = rankdata(np.concatenate([talking_t, silent_s]))[: talking_t.size].sum()
    wins = rank_sum - talking_t.size * (talking_t.size + 1) / 2
    return RocCurve(share_above(silent_s), share_above(talking_t), float(wins / (talking_t.size * silent_s.size)))

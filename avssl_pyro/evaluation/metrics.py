"""Localization metrics over clips, class-agnostic and micro-averaged, with bootstrap intervals."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.matching import Matching, angular_errors, gate_then_assign

Azimuths = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ClipTallies:
    """Counts behind every score, one entry per clip, so that clips can be resampled without matching again.

    Args:
        hits_b: numbers of matched pairs, (B,).
        references_b: numbers of true sources, (B,).
        estimates_b: numbers of estimated sources, (B,).
        errors_b: sum of the errors of the matched pairs, (B,), radians.
    """

    hits_b: npt.NDArray[np.int64]
    references_b: npt.NDArray[np.int64]
    estimates_b: npt.NDArray[np.int64]
    errors_b: npt.NDArray[np.float64]


@dataclass(frozen=True)
class Interval:
    """A confidence interval."""

    low: float
    high: float


@dataclass(frozen=True)
class Scores:
    """Scores over a set of clips.

    Args:
        precision: matched over estimated sources; 0 if nothing was estimated although there was something.
        recall: matched over true sources; 0 if there was nothing to find and something was estimated.
        f_measure: 2 matched / (true + estimated); 1, like precision and recall, if there was nothing and nothing was
            estimated.
        localization_error: mean error over matched pairs, radians; NaN without a matched pair.
        count_accuracy: share of clips with the right number of sources.
        count_confusion: clips by true (row) and estimated (column) number of sources, square.
        tallies: counts of every clip.
    """

    precision: float
    recall: float
    f_measure: float
    localization_error: float
    count_accuracy: float
    count_confusion: npt.NDArray[np.int64]
    tallies: ClipTallies

    @property
    def num_clips(self) -> int:
        return len(self.tallies.hits_b)


def tally(
    reference: Sequence[npt.ArrayLike],
    estimate: Sequence[npt.ArrayLike],
    tolerance: float,
    matching: Matching = gate_then_assign,
) -> ClipTallies:
    """Counts of every clip; arguments as in :func:`evaluate`."""
    if len(reference) != len(estimate):
        raise InputError(
            f"evaluation: {len(reference)} clips have a reference but {len(estimate)} an estimate; give one per clip."
        )
    if not len(reference):
        raise InputError("evaluation: there are no clips; give at least one.")
    if not (np.isfinite(tolerance) and 0.0 < tolerance <= np.pi):
        raise InputError(f"evaluation: a tolerance of {tolerance} rad is out of range; give one in (0, pi] radians.")
    hits, errors = [], []
    for clip, (truth, guess) in enumerate(zip(reference, estimate, strict=True)):
        error_re = angular_errors(truth, guess)
        if not np.isfinite(error_re).all():
            raise InputError(f"evaluation: clip {clip} (counted from 0) has an azimuth that is not a finite number.")
        rows, columns = matching(error_re, tolerance)
        hits.append(len(rows))
        errors.append(float(error_re[rows, columns].sum()))
    return ClipTallies(
        hits_b=np.array(hits, dtype=np.int64),
        references_b=np.array([np.size(truth) for truth in reference], dtype=np.int64),
        estimates_b=np.array([np.size(guess) for guess in estimate], dtype=np.int64),
        errors_b=np.array(errors),
    )


def evaluate(
    reference: Sequence[npt.ArrayLike],
    estimate: Sequence[npt.ArrayLike],
    tolerance: float,
    matching: Matching = gate_then_assign,
) -> Scores:
    """Scores estimated against true azimuths.

    Args:
        reference: true azimuths per clip, radians, any number.
        estimate: estimated azimuths per clip, radians, any number, in any order.
        tolerance: largest error that counts as correct, radians, inclusive.
        matching: :func:`gate_then_assign` or :func:`assign_then_gate`, or another function like them.

    Raises:
        InputError: no clips, lists of unequal length, a tolerance outside (0, pi], or an azimuth that is not finite.
    """
    return summarize(tally(reference, estimate, tolerance, matching))


def summarize(tallies: ClipTallies, clips: npt.NDArray[np.bool_] | None = None) -> Scores:
    """Scores of all tallied clips, or of those selected by a mask, (B,).

    Raises:
        InputError: the mask selects no clip.
    """
    if clips is not None:
        tallies = ClipTallies(
            tallies.hits_b[clips],
            tallies.references_b[clips],
            tallies.estimates_b[clips],
            tallies.errors_b[clips],
        )
    if not len(tallies.hits_b):
        raise InputError("evaluation: there are no clips; give at least one.")
    hits = int(tallies.hits_b.sum())
    truths, guesses = int(tallies.references_b.sum()), int(tallies.estimates_b.sum())
    empty = float(truths + guesses == 0)
    size = int(max(tallies.references_b.max(), tallies.estimates_b.max())) + 1
    confusion = np.zeros((size, size), dtype=np.int64)
    np.add.at(confusion, (tallies.references_b, tallies.estimates_b), 1)
    return Scores(
        precision=hits / guesses if guesses else empty,
        recall=hits / truths if truths else empty,
        f_measure=2 * hits / (truths + guesses) if truths + guesses else 1.0,
        localization_error=float(tallies.errors_b.sum()) / hits if hits else float("nan"),
        count_accuracy=float((tallies.references_b == tallies.estimates_b).mean()),
        count_confusion=confusion,
        tallies=tallies,
    )


# Drawing is by far the slowest part, and all rows of a table use the same draws.
@lru_cache(maxsize=4)
def _resampled_counts(num_clips: int, seed: int, draws: int) -> npt.NDArray[np.float64]:
    """Number of times each clip is drawn in each bootstrap sample, (draws, B)."""
    rng = np.random.default_rng(seed)
    times_sb = rng.multinomial(num_clips, np.full(num_clips, 1.0 / num_clips), size=draws).astype(np.float64)
    times_sb.flags.writeable = False
    return times_sb


def _percentiles(samples: npt.NDArray[np.float64], level: float) -> Interval:
    low, high = np.quantile(samples, [(1.0 - level) / 2, (1.0 + level) / 2])
    return Interval(float(low), float(high))


def bootstrap_f_measure(tallies: ClipTallies, seed: int = 0, draws: int = 2000, level: float = 0.95) -> Interval:
    """Percentile bootstrap interval of the F-measure over clips."""
    times_sb = _resampled_counts(len(tallies.hits_b), seed, draws)
    hits_s = times_sb @ tallies.hits_b
    totals_s = times_sb @ (tallies.references_b + tallies.estimates_b)
    return _percentiles(np.where(totals_s > 0, 2 * hits_s / np.maximum(totals_s, 1.0), 1.0), level)


def bootstrap_count_accuracy(tallies: ClipTallies, seed: int = 0, draws: int = 2000, level: float = 0.95) -> Interval:
    """Percentile bootstrap interval of the count accuracy over clips."""
    times_sb = _resampled_counts(len(tallies.hits_b), seed, draws)
    right_b = (tallies.references_b == tallies.estimates_b).astype(np.float64)
    return _percentiles(times_sb @ right_b / len(right_b), level)


def bootstrap_mean(
    values_b: npt.NDArray[np.float64], seed: int = 0, draws: int = 2000, level: float = 0.95
) -> Interval:
    """Percentile bootstrap interval of the mean of one value per clip."""
    return _percentiles(_resampled_counts(len(values_b), seed, draws) @ values_b / len(values_b), level)

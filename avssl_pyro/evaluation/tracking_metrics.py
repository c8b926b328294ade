"""Tracking metrics: CLEAR MOT over azimuths, and the F-measure of single windows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.matching import GATE_SLACK, angular_errors, gate_then_assign
from avssl_pyro.evaluation.metrics import evaluate

Window = Mapping[int, float]


@dataclass(frozen=True)
class TrackingScores:
    """Scores over the windows of one or more recordings.

    Args:
        f_measure, precision, recall: of single windows, whatever the identities (:func:`evaluate`).
        localization_error: mean error of the matched pairs, radians.
        switches: identity switches: a true source is matched to another estimated identity than the last time it was
            matched, pauses or misses in between or not (mismatches of Bernardin, Stiefelhagen 2008).
        fragments: a true source that was matched is missed while it sounds, and matched again later.
        mota: multiple object tracking accuracy, 1 - (misses + false positives + switches) / true sources.
    """

    f_measure: float
    precision: float
    recall: float
    localization_error: float
    switches: int
    fragments: int
    mota: float


def tracking_scores(
    recordings: Sequence[tuple[Sequence[Window], Sequence[Window]]], tolerance: float
) -> TrackingScores:
    """Scores of tracked recordings.

    Args:
        recordings: for each, true and estimated windows in order of time; a window maps the identities of the sources
            that sound in it to their azimuths, radians. Identities of different recordings are not compared.
        tolerance: largest error that counts as correct, radians, inclusive.

    Raises:
        InputError: true and estimated windows differ in number, there are none, or the tolerance is out of range.
    """
    for number, (reference, estimate) in enumerate(recordings):
        if len(reference) != len(estimate):
            raise InputError(
                f"tracking evaluation: recording {number} has {len(reference)} true and {len(estimate)} estimated "
                "windows; give as many of either."
            )
    windows = [pair for reference, estimate in recordings for pair in zip(reference, estimate, strict=True)]
    scores = evaluate(
        [list(truth.values()) for truth, _ in windows], [list(guess.values()) for _, guess in windows], tolerance
    )
    counts = [_count(reference, estimate, tolerance) for reference, estimate in recordings]
    hits, switches, fragments = (sum(column) for column in zip(*counts, strict=True))
    truths = sum(len(truth) for truth, _ in windows)
    guesses = sum(len(guess) for _, guess in windows)
    mistakes = truths + guesses - 2 * hits + switches
    return TrackingScores(
        f_measure=scores.f_measure,
        precision=scores.precision,
        recall=scores.recall,
        localization_error=scores.localization_error,
        switches=switches,
        fragments=fragments,
        mota=1 - mistakes / truths if truths else float("nan"),
    )


def _count(reference: Sequence[Window], estimate: Sequence[Window], tolerance: float) -> tuple[int, int, int]:
    """Matched pairs, identity switches and fragments of one recording."""
    hits = switches = fragments = 0
    last: dict[int, int] = {}
    missed: set[int] = set()
    for truth, guess in zip(reference, estimate, strict=True):
        pairs = _correspond(truth, guess, last, tolerance)
        hits += len(pairs)
        switches += sum(last.get(true, guessed) != guessed for true, guessed in pairs.items())
        fragments += len(missed & pairs.keys())
        last.update(pairs)
        missed = (missed - pairs.keys()) | {true for true in truth if true in last and true not in pairs}
    return hits, switches, fragments


def _correspond(truth: Window, guess: Window, last: Mapping[int, int], tolerance: float) -> dict[int, int]:
    """True to estimated identities; a pair of before stays one while it is within the tolerance."""
    pairs = {
        true: last[true]
        for true, azimuth in truth.items()
        if last.get(true) in guess and float(angular_errors(azimuth, guess[last[true]])[0, 0]) <= tolerance + GATE_SLACK
    }
    # Two true sources may have been matched to one identity at different times; the nearer keeps it.
    for true, guessed in list(pairs.items()):
        rivals = [other for other, identity in pairs.items() if identity == guessed]
        nearest = min(rivals, key=lambda other: float(angular_errors(truth[other], guess[guessed])[0, 0]))
        if true != nearest:
            del pairs[true]
    free_r = [true for true in truth if true not in pairs]
    free_e = [guessed for guessed in guess if guessed not in pairs.values()]
    error_re = angular_errors([truth[true] for true in free_r], [guess[guessed] for guessed in free_e])
    rows, columns = gate_then_assign(error_re, tolerance)
    return pairs | {free_r[r]: free_e[c] for r, c in zip(rows, columns, strict=True)}

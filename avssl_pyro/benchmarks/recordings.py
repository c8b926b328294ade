"""Methods beside each other on labelled recordings, by the number of talkers: found, missed, and falsely heard."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from avssl_pyro.evaluation.metrics import Azimuths, evaluate
from avssl_pyro.evaluation.tables import ResultTable, TableCell

CLOSE_DEG = 5.0
NEAR_DEG = 10.0
COLUMNS = (f"within {CLOSE_DEG:g}°", f"within {NEAR_DEG:g}°", "false", "mean error", "right count")


@dataclass(frozen=True)
class GroupScores:
    """What a method made of the recordings of one number of talkers.

    Args:
        labelled: directions in the labels.
        close, near: of these, found within 5 and within 10 degrees, each by a direction of its own.
        false: directions given that are not within 10 degrees of a labelled one of their own.
        error: mean error of those found within 10 degrees, radians; NaN without any.
        right_counts: recordings for which as many directions were given as are labelled.
        recordings: all of the group.
    """

    labelled: int
    close: int
    near: int
    false: int
    error: float
    right_counts: int
    recordings: int


def score_group(labelled: Sequence[Azimuths], given: Sequence[Azimuths]) -> GroupScores:
    """Scores one method on some recordings, azimuths in radians.

    Raises:
        InputError: there is no recording, or an azimuth is not finite.
    """
    close, near = (evaluate(labelled, given, float(np.deg2rad(degrees))).tallies for degrees in (CLOSE_DEG, NEAR_DEG))
    hits = int(near.hits_b.sum())
    return GroupScores(
        labelled=int(near.references_b.sum()),
        close=int(close.hits_b.sum()),
        near=hits,
        false=int(near.estimates_b.sum()) - hits,
        error=float(near.errors_b.sum()) / hits if hits else float("nan"),
        right_counts=int((near.references_b == near.estimates_b).sum()),
        recordings=len(near.hits_b),
    )


def comparison_tables(
    labelled: Sequence[Azimuths], given: Mapping[str, Sequence[Azimuths]], notes: tuple[str, ...] = ()
) -> list[ResultTable]:
    """A table for every number of talkers that occurs.

    Args:
        labelled: azimuths of every recording's talkers, radians.
        given: what each method made of the same recordings.
        notes: shown below the last table.
    """
    counts = [len(azimuths) for azimuths in labelled]
    tables = []
    for count in sorted(set(counts)):
        members = [index for index, talkers in enumerate(counts) if talkers == count]
        scores = {
            method: score_group([labelled[index] for index in members], [answers[index] for index in members])
            for method, answers in given.items()
        }
        last = count == max(counts)
        tables.append(
            _table(f"{_number(count, 'talker')}: {_number(len(members), 'recording')}", scores, notes if last else ())
        )
    return tables


def _number(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _table(title: str, scores: Mapping[str, GroupScores], notes: tuple[str, ...]) -> ResultTable:
    lines = tuple((method, tuple(TableCell(text) for text in _cells(score))) for method, score in scores.items())
    return ResultTable(title, COLUMNS, lines, notes)


def _cells(score: GroupScores) -> tuple[str, ...]:
    return (
        f"{score.close} of {score.labelled}",
        f"{score.near} of {score.labelled}",
        str(score.false),
        "–" if np.isnan(score.error) else f"{np.rad2deg(score.error):.1f}°",
        f"{score.right_counts} of {score.recordings}",
    )

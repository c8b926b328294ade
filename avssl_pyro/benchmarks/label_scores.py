"""Scores of a recording's directions against its labels, per 100 ms frame, whatever the class."""

from collections.abc import Mapping, Sequence

import numpy as np

from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.metrics import Azimuths, Scores, evaluate
from avssl_pyro.evaluation.tables import ResultTable, TableCell
from avssl_pyro.io.dcase import DcaseRow, azimuths_by_frame

COLUMNS = ("F", "precision", "recall", "mean error", "right count")


def azimuths_of_frames(rows: Sequence[DcaseRow], num_frames: int) -> list[Azimuths]:
    """Azimuths of the sources of every frame, radians; those closer than 5 degrees are one, as labels have it.

    Raises:
        InputError: there is a frame beyond the last.
    """
    frames = azimuths_by_frame(rows)
    if frames and max(frames) >= num_frames:
        raise InputError(f"there is a source in frame {max(frames)}, but the recording has {num_frames} frames.")
    return [np.array(frames.get(frame, ())) for frame in range(num_frames)]


def score_table(
    labelled: Sequence[Azimuths], given: Mapping[str, Sequence[Azimuths]], tolerance_deg: float, title: str
) -> ResultTable:
    """A row for each method.

    Args:
        labelled: who sounds in every frame, radians.
        given: what each method says.
        tolerance_deg: largest error that counts as correct.
        title: of the table.
    """
    tolerance = float(np.deg2rad(tolerance_deg))
    lines = tuple((name, _cells(evaluate(labelled, answers, tolerance))) for name, answers in given.items())
    return ResultTable(title, COLUMNS, lines, ())


def _cells(scores: Scores) -> tuple[TableCell, ...]:
    error = scores.localization_error
    return (
        TableCell(f"{scores.f_measure:.3f}"),
        TableCell(f"{scores.precision:.3f}"),
        TableCell(f"{scores.recall:.3f}"),
        TableCell("–" if np.isnan(error) else f"{np.rad2deg(error):.1f}°"),
        TableCell(f"{scores.count_accuracy:.3f}"),
    )

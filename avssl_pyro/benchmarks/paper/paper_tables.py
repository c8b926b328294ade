"""Rows laid out as the paper's Tables I-III, its own figures below them, and the cells below the paper."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from avssl_pyro.benchmarks.paper.published_results import MICROPHONES, PAPER_TABLES, PROPOSED, TALKERS, PaperTable
from avssl_pyro.benchmarks.result_tables import (
    GIVEN_THE_COUNT,
    HEADLINE_TOLERANCE_DEG,
    Bounds,
    MethodRows,
    ResultRow,
    ScoreColumn,
    count_accuracy,
    count_interval,
    count_note,
    f_interval,
    f_measure,
    method_table,
)
from avssl_pyro.evaluation.tables import Table

BASELINES = ("srp-phat", "music", "norm-music")


@dataclass(frozen=True)
class _Measure:
    """Number and interval of a row that a table of the paper shows."""

    value: Callable[[ResultRow], float]
    interval: Callable[[ResultRow], Bounds]
    unfair: frozenset[str] = frozenset()


_MEASURES = {
    "F-measure": _Measure(f_measure, f_interval),
    "count accuracy": _Measure(count_accuracy, count_interval, GIVEN_THE_COUNT),
}


def _microphones(rows: Sequence[ResultRow]) -> list[int]:
    return sorted({*MICROPHONES, *(row.microphones for row in rows)})


def paper_tables(rows: Sequence[ResultRow], tolerance_deg: float = HEADLINE_TOLERANCE_DEG) -> list[Table[MethodRows]]:
    """Tables I, II and III, one column per number of microphones M and of talkers L."""
    tables = []
    for paper in PAPER_TABLES:
        part = [row for row in rows if row.condition == paper.condition]
        theirs = _paper_rows(paper, tolerance_deg)
        measure = _MEASURES[paper.measure]
        columns = [
            ScoreColumn(
                f"M={microphones} L={talkers}",
                talkers,
                tolerance_deg,
                measure.value,
                interval=measure.interval,
                unfair=measure.unfair | {row.method for row in theirs},
                microphones=microphones,
            )
            for microphones in _microphones(rows)
            for talkers in TALKERS
        ]
        notes = (
            f"M: microphones, L: talkers; tolerance {tolerance_deg:g}°; ±: half the 95 % bootstrap interval. "
            "Rows marked (paper) are the paper's figures, measured by its authors on other data.",
            *count_note(part),
        )
        title = f"Table {paper.number}: {paper.measure}, {paper.condition}"
        tables.append(method_table(columns, [*part, *theirs], title, notes))
    return tables


def _paper_rows(paper: PaperTable, tolerance_deg: float) -> list[ResultRow]:
    """The paper's figures, without an interval; measures it does not state are NaN."""
    return [
        ResultRow(
            condition=paper.condition,
            microphones=microphones,
            sources=talkers,
            method=f"{method} (paper)",
            tolerance_deg=tolerance_deg,
            f_measure=figure if paper.measure == "F-measure" else math.nan,
            precision=math.nan,
            recall=math.nan,
            count_accuracy=figure if paper.measure == "count accuracy" else math.nan,
            localization_error_deg=math.nan,
            clips=0,
        )
        for method, figures in paper.figures.items()
        for (microphones, talkers), figure in figures.items()
    ]


def overall_table(rows: Sequence[ResultRow], tolerance_deg: float = HEADLINE_TOLERANCE_DEG) -> Table[MethodRows]:
    """F-measure over all clips, whatever the number of talkers, per condition and number of microphones."""
    columns = [
        ScoreColumn(
            f"{condition} M={number}",
            "all",
            tolerance_deg,
            f_measure,
            interval=f_interval,
            microphones=number,
            condition=condition,
        )
        for condition in dict.fromkeys(row.condition for row in rows)
        for number in sorted({row.microphones for row in rows if row.condition == condition})
    ]
    note = f"tolerance {tolerance_deg:g}°; ±: half the 95 % bootstrap interval."
    return method_table(columns, rows, "F-measure, all numbers of talkers", (note,))


def sweep_tables(rows: Sequence[ResultRow]) -> list[Table[MethodRows]]:
    """F-measure over all clips at every tolerance, one table per condition."""
    tables = []
    for condition in dict.fromkeys(row.condition for row in rows):
        part = [row for row in rows if row.condition == condition]
        columns = [
            ScoreColumn(f"M={number} {tolerance:g}°", "all", tolerance, f_measure, microphones=number)
            for number in sorted({row.microphones for row in part})
            for tolerance in sorted({row.tolerance_deg for row in part})
        ]
        note = f"All numbers of talkers; thresholds were tuned at {HEADLINE_TOLERANCE_DEG:g}°."
        tables.append(method_table(columns, part, f"F-measure by tolerance, {condition}", (note,)))
    return tables


def behind(rows: Sequence[ResultRow], tolerance_deg: float = HEADLINE_TOLERANCE_DEG) -> list[str]:
    """Cells of Tables I-III with ``amortized`` below the paper, or ``refined`` not above every baseline.

    The paper's figures have two decimals, so ours are rounded before the comparison.
    """
    sentences = []
    for paper in PAPER_TABLES:
        value = _MEASURES[paper.measure].value
        for microphones in _microphones(rows):
            for talkers in TALKERS:
                cell = (paper.condition, microphones, talkers, tolerance_deg)
                shown = {
                    row.method: value(row)
                    for row in rows
                    if (row.condition, row.microphones, row.sources, row.tolerance_deg) == cell
                }
                where = f"Table {paper.number}, M={microphones}, L={talkers}"
                sentences += _behind_in(where, shown, paper, (microphones, talkers))
    return sentences


def _behind_in(where: str, shown: dict[str, float], paper: PaperTable, cell: tuple[int, int]) -> list[str]:
    sentences = []
    theirs = paper.figures[PROPOSED].get(cell)
    if "amortized" in shown and theirs is not None and round(shown["amortized"], 2) < theirs:
        ours = shown["amortized"]
        sentences.append(f"{where}: amortized {ours:.2f} is below {theirs:.2f}, the paper's {PROPOSED} (other data).")
    if "refined" in shown:
        for name in BASELINES:
            if name in shown and shown["refined"] <= shown[name]:
                sentences.append(
                    f"{where}: refined {shown['refined']:.3f} is not ahead of {name} {shown[name]:.3f} (same clips)."
                )
    return sentences

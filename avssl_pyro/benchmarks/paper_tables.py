"""Our rows laid out like the paper's Tables I-III, its own figures below them, and the cells in which we are behind."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from avssl_pyro.benchmarks.published_results import MICROPHONES, PAPER_TABLES, PROPOSED, TALKERS, PaperTable
from avssl_pyro.evaluation.tables import (
    HEADLINE_TOLERANCE_DEG,
    TOLD_THE_COUNT,
    Column,
    ResultRow,
    ResultTable,
    TableCell,
    count_accuracy,
    count_interval,
    f_interval,
    f_measure,
    order_methods,
    render,
)

BASELINES = ("srp-phat", "music", "norm-music")


@dataclass(frozen=True)
class _Measure:
    """How the number of a paper's table is read from a row of ours."""

    value: Callable[[ResultRow], float]
    interval: Callable[[ResultRow], tuple[float | None, float | None]]
    unfair: frozenset[str] = frozenset()


_MEASURES = {
    "F-measure": _Measure(f_measure, f_interval),
    "count accuracy": _Measure(count_accuracy, count_interval, TOLD_THE_COUNT),
}


def _microphones(rows: Sequence[ResultRow]) -> list[int]:
    return sorted({*MICROPHONES, *(row.microphones for row in rows)})


def paper_tables(rows: Sequence[ResultRow], tolerance_deg: float = HEADLINE_TOLERANCE_DEG) -> list[ResultTable]:
    """Tables I, II and III, one column per number of microphones M and of talkers L."""
    tables = []
    for paper in PAPER_TABLES:
        part = [row for row in rows if row.condition == paper.condition]
        measure = _MEASURES[paper.measure]
        cells = [(microphones, talkers) for microphones in _microphones(rows) for talkers in TALKERS]
        columns = [
            Column(
                f"M={microphones} L={talkers}",
                talkers,
                tolerance_deg,
                measure.value,
                interval=measure.interval,
                unfair=measure.unfair,
                microphones=microphones,
            )
            for microphones, talkers in cells
        ]
        table = render(columns, part, f"Table {paper.number}: {paper.measure}, {paper.condition}", ())
        theirs = tuple(
            (f"{method} (paper)", tuple(_paper_cell(figures.get(cell)) for cell in cells))
            for method, figures in paper.figures.items()
        )
        notes = (
            f"M: microphones, L: talkers; tolerance {tolerance_deg:g}°; ±: half the 95 % bootstrap interval. "
            "Rows marked (paper) are the paper's figures, measured by its authors on other data.",
            *(("random is told the true count.",) if "random" in {row.method for row in part} else ()),
        )
        tables.append(replace(table, lines=(*table.lines, *theirs), notes=notes))
    return tables


def _paper_cell(figure: float | None) -> TableCell:
    return TableCell("–" if figure is None else f"{figure:.2f}")


def overall_table(rows: Sequence[ResultRow], tolerance_deg: float = HEADLINE_TOLERANCE_DEG) -> ResultTable:
    """F-measure over all clips, whatever the number of talkers, per condition and number of microphones."""
    lines: dict[str, list[TableCell]] = {method: [] for method in order_methods(row.method for row in rows)}
    headers: list[str] = []
    for condition in dict.fromkeys(row.condition for row in rows):
        part = [row for row in rows if row.condition == condition]
        columns = [
            Column(f"{condition} M={number}", "all", tolerance_deg, f_measure, interval=f_interval, microphones=number)
            for number in sorted({row.microphones for row in part})
        ]
        table = render(columns, part, "", ())
        headers += table.columns
        for method, cells in table.lines:
            lines[method] += cells
    note = f"tolerance {tolerance_deg:g}°; ±: half the 95 % bootstrap interval."
    return ResultTable(
        "F-measure, all numbers of talkers",
        tuple(headers),
        tuple((method, tuple(cells)) for method, cells in lines.items()),
        (note,),
    )


def sweep_tables(rows: Sequence[ResultRow]) -> list[ResultTable]:
    """F-measure over all clips at every tolerance, one table per condition."""
    tables = []
    for condition in dict.fromkeys(row.condition for row in rows):
        part = [row for row in rows if row.condition == condition]
        columns = [
            Column(f"M={number} {tolerance:g}°", "all", tolerance, f_measure, microphones=number)
            for number in sorted({row.microphones for row in part})
            for tolerance in sorted({row.tolerance_deg for row in part})
        ]
        note = f"All numbers of talkers; thresholds were tuned at {HEADLINE_TOLERANCE_DEG:g}°."
        tables.append(render(columns, part, f"F-measure by tolerance, {condition}", (note,)))
    return tables


def behind(rows: Sequence[ResultRow], tolerance_deg: float = HEADLINE_TOLERANCE_DEG) -> list[str]:
    """The cells of Tables I-III in which ``amortized`` is below the paper, or ``refined`` not above every baseline.

    The paper's figures have two decimals, so ours are rounded before they are compared with them.
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

"""Scores of a comparison as rows, in tables of methods, and as report.json and report.md."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rich.console import Console

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.evaluation.baselines import BASELINES
from avssl_pyro.evaluation.tables import Column, Table, json_rows, print_tables

CHANCE = ("random", "constant-count")
# From plain to refined.
TRAINED = ("audio-only refined", "no-audio-net", "amortized", "refined")
HEADLINE_TOLERANCE_DEG = 10.0
GIVEN_THE_COUNT = frozenset({"random"})
CHANCE_METHODS = frozenset(CHANCE)


@dataclass(frozen=True)
class ResultRow:
    """Scores of one method in one cell; one object of ``report.json``.

    Args:
        condition: name of the condition, e.g. ``some-silent``.
        microphones: number of microphones.
        sources: true number of talkers of the scored clips, or ``"all"``.
        method: name of the method.
        tolerance_deg: largest error that counts as correct, degrees, inclusive.
        f_measure, precision, recall: micro-averaged over clips.
        count_accuracy: share of clips with the right number of sources.
        localization_error_deg: mean error of matched pairs, degrees; NaN without any.
        clips: number of scored clips.
        f_low, f_high: ends of the 95 % bootstrap interval of the F-measure.
        count_low, count_high: ends of that of the count accuracy.
    """

    condition: str
    microphones: int
    sources: int | str
    method: str
    tolerance_deg: float
    f_measure: float
    precision: float
    recall: float
    count_accuracy: float
    localization_error_deg: float
    clips: int
    f_low: float | None = None
    f_high: float | None = None
    count_low: float | None = None
    count_high: float | None = None


@dataclass(frozen=True)
class MethodRows:
    """All rows of one method: one line of a table."""

    method: str
    rows: tuple[ResultRow, ...]


Bounds = tuple[float | None, float | None]


@dataclass(frozen=True)
class ScoreColumn:
    """Selection of a row for a column, and of the number shown from it.

    Args:
        header: title of the column.
        sources, tolerance_deg: of the rows shown.
        value: number shown.
        better: which values are marked as best.
        decimals: number of decimals.
        interval: ends of the interval shown beside the number; by default none.
        unfair: methods never marked as best: the number was given to them, or they match by chance.
        microphones, condition: of the rows shown; by default any.
    """

    header: str
    sources: int | str
    tolerance_deg: float
    value: Callable[[ResultRow], float]
    better: Literal["high", "low"] = "high"
    decimals: int = 2
    interval: Callable[[ResultRow], Bounds] | None = None
    unfair: frozenset[str] = frozenset()
    microphones: int | None = None
    condition: str | None = None

    def shows(self, row: ResultRow) -> bool:
        return (
            (row.sources, row.tolerance_deg) == (self.sources, self.tolerance_deg)
            and self.microphones in (None, row.microphones)
            and self.condition in (None, row.condition)
        )

    def column(self) -> Column[MethodRows]:
        """Column of a table of methods."""

        def found(line: MethodRows) -> ResultRow | None:
            return next((row for row in reversed(line.rows) if self.shows(row)), None)

        def number(line: MethodRows) -> float:
            row = found(line)
            return math.nan if row is None else self.value(row)

        def spread(line: MethodRows) -> str:
            row = found(line)
            low, high = (None, None) if row is None or self.interval is None else self.interval(row)
            return "" if low is None or high is None else f" {plus_minus(low, high)}"

        return Column(
            self.header,
            number,
            f"{{:.{self.decimals}f}}",
            self.better,
            contends=lambda line: line.method not in self.unfair,
            suffix=spread,
        )


def method_order() -> tuple[str, ...]:
    """Names of the methods as tables list them: chance, the baselines registered by now, trained methods."""
    return (*CHANCE, *(baseline.name for baseline in BASELINES), *TRAINED)


def order_methods(names: Iterable[str]) -> list[str]:
    """Distinct names in the order of the tables; unknown ones follow as they come."""
    known = {name: rank for rank, name in enumerate(method_order())}
    return sorted(dict.fromkeys(names), key=lambda name: known.get(name, len(known)))


def plus_minus(low: float, high: float) -> str:
    """Half the width of an interval, short enough for six of them in a terminal: ``±.04``."""
    return f"±{(high - low) / 2:.2f}".replace("0.", ".", 1)


def method_table(
    columns: Iterable[ScoreColumn], rows: Sequence[ResultRow], title: str, notes: tuple[str, ...] = ()
) -> Table[MethodRows]:
    """Table with one line for each method of the rows."""
    lines = [
        MethodRows(method, tuple(row for row in rows if row.method == method))
        for method in order_methods(row.method for row in rows)
    ]
    name: Column[MethodRows] = Column("method", lambda line: line.method)
    return Table(lines, [name, *(column.column() for column in columns)], title, notes)


def f_measure(row: ResultRow) -> float:
    return row.f_measure


def f_interval(row: ResultRow) -> Bounds:
    return row.f_low, row.f_high


def count_accuracy(row: ResultRow) -> float:
    return row.count_accuracy


def count_interval(row: ResultRow) -> Bounds:
    return row.count_low, row.count_high


def _main_columns(counts: Sequence[int], tolerance_deg: float) -> list[ScoreColumn]:
    given = GIVEN_THE_COUNT
    return [
        ScoreColumn("F", "all", tolerance_deg, f_measure, interval=f_interval),
        *(ScoreColumn(f"F L={count}", count, tolerance_deg, f_measure) for count in counts),
        ScoreColumn("prec.", "all", tolerance_deg, lambda row: row.precision),
        ScoreColumn("recall", "all", tolerance_deg, lambda row: row.recall),
        ScoreColumn("count", "all", tolerance_deg, count_accuracy, unfair=given),
        *(ScoreColumn(f"count L={count}", count, tolerance_deg, count_accuracy, unfair=given) for count in counts),
        ScoreColumn(
            "error °", "all", tolerance_deg, lambda row: row.localization_error_deg, "low", 1, unfair=CHANCE_METHODS
        ),
    ]


def result_tables(rows: Sequence[ResultRow], headline_deg: float = HEADLINE_TOLERANCE_DEG) -> list[Table[MethodRows]]:
    """Tables of each condition and array: all scores at the tolerance closest to the headline, and F at every one."""
    tables = []
    for condition, microphones in dict.fromkeys((row.condition, row.microphones) for row in rows):
        part = [row for row in rows if (row.condition, row.microphones) == (condition, microphones)]
        tolerances = sorted({row.tolerance_deg for row in part})
        headline = min(tolerances, key=lambda tolerance: abs(tolerance - headline_deg))
        counts = sorted({row.sources for row in part if isinstance(row.sources, int)})
        clips = {row.sources: row.clips for row in part}
        shares = ", ".join(f"{clips[count]} with L={count}" for count in counts)
        where = f"{condition}, {microphones} microphones"
        notes = (
            f"{clips.get('all', sum(clips.values()))} clips ({shares}), L: talkers; ±: half the 95 % interval; "
            "count: share of clips with the right number of sources; error: mean over matched pairs.",
            *count_note(part),
        )
        tables.append(method_table(_main_columns(counts, headline), part, f"{where}, tolerance {headline:g}°", notes))
        if len(tolerances) > 1:
            sweep = [ScoreColumn(f"{tolerance:g}°", "all", tolerance, f_measure) for tolerance in tolerances]
            tables.append(method_table(sweep, part, f"{where}, F by tolerance"))
    return tables


def count_note(rows: Iterable[ResultRow]) -> tuple[str, ...]:
    """Note on the row ``random``, where there is one."""
    return ("random uses the true count.",) if any(row.method == "random" for row in rows) else ()


def write_report(rows: Sequence[ResultRow], folder: Path) -> None:
    """Writes ``report.json``, a list with one object for each row, and ``report.md``.

    The folder is made if it is missing; each file appears whole or not at all.

    Raises:
        OSError: the folder cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / "report.json", json_rows(rows).encode())
    tables = "\n".join(table.markdown() for table in result_tables(rows))
    write_atomically(folder / "report.md", f"# Localization results\n\n{tables}".encode())


def print_report(rows: Sequence[ResultRow], console: Console | None = None) -> None:
    """Prints the tables of the report."""
    print_tables(result_tables(rows), console)

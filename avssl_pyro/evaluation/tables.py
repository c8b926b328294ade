"""Result rows arranged for reading: one table per condition and array, methods below each other, best values marked."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

# Trivial rows first, then audio-only baselines, then our methods from plain to refined; others follow as they come.
METHOD_ORDER = (
    "random",
    "constant-count",
    "srp-phat",
    "music",
    "norm-music",
    "audio-only refined",
    "no-audio-net",
    "amortized",
    "refined",
)
HEADLINE_TOLERANCE_DEG = 10.0
TOLD_THE_COUNT = frozenset({"random"})


@dataclass(frozen=True)
class ResultRow:
    """Scores of one method in one cell; the unit of ``report.json``.

    Args:
        condition: name of the condition, e.g. ``some-silent``.
        microphones: number of microphones.
        sources: true number of talkers of the clips scored, or ``"all"``.
        method: name of the method.
        tolerance_deg: largest error that counts as correct, degrees, inclusive.
        f_measure, precision, recall: micro-averaged over clips.
        count_accuracy: share of clips with the right number of sources.
        localization_error_deg: mean error of matched pairs, degrees; NaN without any.
        clips: number of clips scored.
        f_low, f_high: ends of the 95 % bootstrap interval of the F-measure.
        count_low, count_high: of the count accuracy.
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
class TableCell:
    text: str
    best: bool = False


@dataclass(frozen=True)
class ResultTable:
    """A table ready for any renderer; every line is a name, mostly a method's, and its cells."""

    title: str
    columns: tuple[str, ...]
    lines: tuple[tuple[str, tuple[TableCell, ...]], ...]
    notes: tuple[str, ...] = ()
    corner: str = "method"


Ends = tuple[float | None, float | None]


@dataclass(frozen=True)
class Column:
    """How one column is read from the rows: which cell, which number, and which way is better.

    Args:
        header: title of the column.
        sources, tolerance_deg: rows of these are shown.
        value: the number shown.
        better: which values are marked as best.
        decimals: shown.
        interval: ends of the interval shown beside the number; by default none is.
        unfair: methods whose value is no merit: they were told the number, or match by chance only.
        microphones: rows of this many are shown; by default of any, for tables of one array.
    """

    header: str
    sources: int | str
    tolerance_deg: float
    value: Callable[[ResultRow], float]
    better: Literal["high", "low"] = "high"
    decimals: int = 2
    interval: Callable[[ResultRow], Ends] | None = None
    unfair: frozenset[str] = frozenset()
    microphones: int | None = None

    def shows(self, row: ResultRow) -> bool:
        return (row.sources, row.tolerance_deg) == (self.sources, self.tolerance_deg) and (
            self.microphones in (None, row.microphones)
        )


def _first_seen(values: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(values))


def order_methods(names: Iterable[str]) -> list[str]:
    """Distinct names in the order of the tables."""
    known = {name: rank for rank, name in enumerate(METHOD_ORDER)}
    return sorted(_first_seen(names), key=lambda name: known.get(name, len(known)))


def plus_minus(low: float, high: float) -> str:
    """Half the width of an interval, short enough for six of them in a terminal: ``±.04``."""
    return f"±{(high - low) / 2:.2f}".replace("0.", ".", 1)


def render(columns: Sequence[Column], rows: Sequence[ResultRow], title: str, notes: tuple[str, ...]) -> ResultTable:
    """A table with one line per method of the rows, in the order of the tables; a dash where there is no number."""
    methods = order_methods(row.method for row in rows)
    cells: dict[str, list[TableCell]] = {method: [] for method in methods}
    for column in columns:
        found = {row.method: row for row in rows if column.shows(row)}
        shown = {method: round(column.value(row), column.decimals) for method, row in found.items()}
        fair = [value for m, value in shown.items() if m not in column.unfair and not math.isnan(value)]
        best = None if len(fair) < 2 else (max(fair) if column.better == "high" else min(fair))
        for method in methods:
            if math.isnan(shown.get(method, math.nan)):
                cells[method].append(TableCell("–"))
                continue
            text = f"{shown[method]:.{column.decimals}f}"
            low, high = column.interval(found[method]) if column.interval else (None, None)
            if low is not None and high is not None:
                text += f" {plus_minus(low, high)}"
            cells[method].append(TableCell(text, shown[method] == best and method not in column.unfair))
    lines = tuple((method, tuple(cells[method])) for method in methods)
    return ResultTable(title, tuple(column.header for column in columns), lines, notes)


def f_measure(row: ResultRow) -> float:
    return row.f_measure


def f_interval(row: ResultRow) -> Ends:
    return row.f_low, row.f_high


def count_accuracy(row: ResultRow) -> float:
    return row.count_accuracy


def count_interval(row: ResultRow) -> Ends:
    return row.count_low, row.count_high


def _main_columns(counts: Sequence[int], tolerance_deg: float) -> list[Column]:
    lucky = frozenset({"random", "constant-count"})
    return [
        Column("F", "all", tolerance_deg, f_measure, interval=f_interval),
        *(Column(f"F L={count}", count, tolerance_deg, f_measure) for count in counts),
        Column("prec.", "all", tolerance_deg, lambda row: row.precision),
        Column("recall", "all", tolerance_deg, lambda row: row.recall),
        Column("count", "all", tolerance_deg, count_accuracy, unfair=TOLD_THE_COUNT),
        *(Column(f"count L={count}", count, tolerance_deg, count_accuracy, unfair=TOLD_THE_COUNT) for count in counts),
        Column("error °", "all", tolerance_deg, lambda row: row.localization_error_deg, "low", 1, unfair=lucky),
    ]


def result_tables(rows: Sequence[ResultRow], headline_deg: float = HEADLINE_TOLERANCE_DEG) -> list[ResultTable]:
    """Tables of all rows: per condition and array one at the tolerance closest to the headline, then one F sweep."""
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
            *(("random is told the true count.",) if any(row.method == "random" for row in part) else ()),
        )
        tables.append(render(_main_columns(counts, headline), part, f"{where}, tolerance {headline:g}°", notes))
        if len(tolerances) > 1:
            sweep = [Column(f"{tolerance:g}°", "all", tolerance, f_measure) for tolerance in tolerances]
            tables.append(render(sweep, part, f"{where}, F by tolerance", ()))
    return tables

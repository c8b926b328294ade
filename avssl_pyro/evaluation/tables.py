"""Tables of results: rows of any type, and columns with names and formats."""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Generic, Literal, TypeVar

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

MISSING = "–"
RowT = TypeVar("RowT")


@dataclass(frozen=True)
class Cell:
    """Text of a cell, and whether it is the best of its column."""

    text: str
    best: bool = False


@dataclass(frozen=True)
class Column(Generic[RowT]):
    """One column of a table.

    Args:
        header: title of the column.
        value: number or text of a row; NaN and None are shown as a dash.
        spec: format of the value, as of ``str.format``.
        better: which values are marked as best; by default none is.
        contends: rows among which the best is sought; by default all.
        suffix: text after the value, such as the width of an interval.
    """

    header: str
    value: Callable[[RowT], float | str | None]
    spec: str = "{}"
    better: Literal["high", "low"] | None = None
    contends: Callable[[RowT], bool] = lambda _: True
    suffix: Callable[[RowT], str] = lambda _: ""

    def cells(self, rows: Sequence[RowT]) -> list[Cell]:
        """Cells of all rows."""
        values = [self.value(row) for row in rows]
        shown = [MISSING if _missing(value) else self.spec.format(value) for value in values]
        contenders = [
            (value, text)
            for row, value, text in zip(rows, values, shown, strict=True)
            if isinstance(value, float | int) and not _missing(value) and self.contends(row)
        ]
        best = None
        if self.better is not None and len(contenders) > 1:
            _, best = (max if self.better == "high" else min)(contenders, key=lambda contender: contender[0])
        return [
            Cell(text if text == MISSING else text + self.suffix(row), text == best and self.contends(row))
            for row, text in zip(rows, shown, strict=True)
        ]


@dataclass(frozen=True)
class Table(Generic[RowT]):
    """Rows under columns, of which the first names the row.

    Args:
        rows: one line each.
        columns: the first is aligned to the left, the others to the right.
        title: shown above.
        notes: shown below, one paragraph each.
    """

    rows: Sequence[RowT]
    columns: Sequence[Column[RowT]]
    title: str = ""
    notes: tuple[str, ...] = ()

    @property
    def headers(self) -> tuple[str, ...]:
        """Titles of all columns."""
        return tuple(column.header for column in self.columns)

    def cells(self) -> list[tuple[Cell, ...]]:
        """Cells of every line."""
        return list(zip(*(column.cells(self.rows) for column in self.columns), strict=True))

    def texts(self) -> dict[str, list[str]]:
        """Texts of every line, by its first cell."""
        return {first.text: [cell.text for cell in others] for first, *others in self.cells()}

    def __rich__(self) -> RichTable:
        # Narrow enough for a terminal of 80 columns.
        table = RichTable(box=box.SIMPLE_HEAD, pad_edge=False, padding=0)
        for index, header in enumerate(self.headers):
            table.add_column(header.replace(" ", "\n") if index else header, justify="right" if index else "left")
        for cells in self.cells():
            table.add_row(*(Text(cell.text, "bold green" if cell.best else "") for cell in cells))
        return table

    def print(self, console: Console | None = None) -> None:
        """Prints title, lines and notes on the terminal."""
        console = console or Console()
        if self.title:
            console.print(Text(self.title, "bold"))
        console.print(self)
        for note in self.notes:
            console.print(Text(note, "dim"))
        console.print()

    def markdown(self) -> str:
        """Title, lines and notes as Markdown."""
        lines = [f"## {self.title}", ""] if self.title else []
        lines += [f"| {' | '.join(self.headers)} |", f"|{'|'.join(['---'] + ['---:'] * (len(self.columns) - 1))}|"]
        lines += [f"| {' | '.join(f'**{c.text}**' if c.best else c.text for c in cells)} |" for cells in self.cells()]
        notes = [line for note in self.notes for line in (note, "")]
        return "\n".join([*lines, "", *notes])

    def json(self) -> str:
        """Rows, which are dataclasses, as a JSON list of objects; NaN is null."""
        return json_rows(self.rows)


def print_tables(tables: Iterable[Table[Any]], console: Console | None = None) -> None:
    """Prints tables below each other."""
    for table in tables:
        table.print(console)


def row_dict(row: Any) -> dict[str, object]:
    """Fields of a dataclass as JSON values; NaN and infinity are null."""
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in asdict(row).items()
    }


def json_rows(rows: Iterable[Any]) -> str:
    """Dataclasses as a JSON list of objects."""
    return f"{json.dumps([row_dict(row) for row in rows], indent=1, allow_nan=False)}\n"


def _missing(value: float | str | None) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))

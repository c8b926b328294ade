"""Result rows on disk (JSON for programs, Markdown for people) and on the terminal."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.evaluation.tables import ResultRow, ResultTable, result_tables

__all__ = ["ResultRow", "print_table", "write_report"]


def _finite_or_none(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def row_dict(row: ResultRow) -> dict[str, object]:
    """A row as JSON values, NaN as null."""
    return {key: _finite_or_none(value) for key, value in asdict(row).items()}


def markdown(table: ResultTable) -> str:
    rule = "|".join(["---"] + ["---:"] * len(table.columns))
    """A table with its title and notes as Markdown."""
    lines = [f"## {table.title}", "", f"| {table.corner} | {' | '.join(table.columns)} |", f"|{rule}|"]
    for method, cells in table.lines:
        texts = (f"**{cell.text}**" if cell.best else cell.text for cell in cells)
        lines.append(f"| {method} | {' | '.join(texts)} |")
    notes = [line for note in table.notes for line in (note, "")]
    return "\n".join([*lines, "", *notes])


def write_report(rows: Sequence[ResultRow], folder: Path) -> None:
    """Writes ``report.json``, a list with one object per row (NaN as null), and ``report.md`` into a folder.

    The folder is made if it is not there; each file appears whole or not at all.

    Raises:
        OSError: the folder cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    data = [row_dict(row) for row in rows]
    write_atomically(folder / "report.json", f"{json.dumps(data, indent=1, allow_nan=False)}\n".encode())
    tables = "\n".join(markdown(table) for table in result_tables(rows))
    write_atomically(folder / "report.md", f"# Localization results\n\n{tables}".encode())


def print_table(rows: Sequence[ResultRow], console: Console | None = None) -> None:
    """Prints the tables of the report on the terminal."""
    print_tables(result_tables(rows), console)


def print_tables(tables: Sequence[ResultTable], console: Console | None = None) -> None:
    """Prints tables on the terminal."""
    console = console or Console()
    for result in tables:
        # Narrow enough for a terminal of 80 columns.
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=0)
        table.add_column(result.corner, no_wrap=True)
        for column in result.columns:
            table.add_column(column.replace(" ", "\n"), justify="right", no_wrap=True)
        for method, cells in result.lines:
            table.add_row(method, *(Text(cell.text, "bold green" if cell.best else "") for cell in cells))
        console.print(Text(result.title, "bold"), table, sep="")
        for note in result.notes:
            console.print(Text(note, "dim"))
        console.print()

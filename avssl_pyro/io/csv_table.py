"""CSV tables whose first line names the columns."""

import csv
from dataclasses import dataclass
from pathlib import Path

from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class CsvLine:
    """One line of a table.

    Args:
        where: file name and line number, for messages.
        cells: texts by column; None where the line ends before the column.
    """

    where: str
    cells: dict[str, str | None]

    def file_name(self, column: str) -> str:
        """Returns the file name in a column that requires one.

        Raises:
            InputError: the cell is empty.
        """
        text = self.cells[column]
        if not text:
            raise InputError(f"{self.where}: column '{column}' is empty; give a file name.")
        return text


@dataclass(frozen=True)
class CsvTable:
    """Column names of a file and its lines below the first, at least one."""

    columns: tuple[str, ...]
    lines: tuple[CsvLine, ...]


def read_csv_table(path: Path, required: tuple[str, ...]) -> CsvTable:
    """Reads a UTF-8 table, with or without a byte order mark; skips empty lines.

    Raises:
        InputError: the file is missing or no CSV, lacks a required column, or has no line below the first.
    """
    first_line = ",".join(required)
    if not path.is_file():
        raise InputError(f"{path}: no such file; write one with the first line {first_line} and a line for each.")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            columns = tuple(reader.fieldnames or ())
            lines = tuple(CsvLine(f"{path}, line {reader.line_num}", row) for row in reader)
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as CSV ({error}).") from error
    missing = [column for column in required if column not in columns]
    if missing:
        raise InputError(f"{path}: column '{missing[0]}' is missing; the first line must be: {first_line}")
    if not lines:
        raise InputError(f"{path}: holds nothing below its first line; give a line with {first_line} for each.")
    return CsvTable(columns, lines)

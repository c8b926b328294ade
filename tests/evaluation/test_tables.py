import json
import math
from dataclasses import dataclass

from avssl_pyro.evaluation.tables import Cell, Column, Table


@dataclass(frozen=True)
class Row:
    name: str
    score: float


ROWS = [Row("a", 0.5), Row("b", 0.751), Row("c", 0.749), Row("cheat", 1.0), Row("none", math.nan)]
TABLE = Table(
    ROWS,
    [
        Column("method", lambda row: row.name),
        Column("F", lambda row: row.score, "{:.2f}", "high", lambda row: row.name != "cheat", lambda _: " !"),
    ],
    "title",
    ("a note",),
)


def test_the_best_as_shown_is_marked_among_those_that_contend():
    assert [cells[1] for cells in TABLE.cells()] == [
        Cell("0.50 !"),
        Cell("0.75 !", best=True),
        Cell("0.75 !", best=True),
        Cell("1.00 !"),
        Cell("–"),
    ]


def test_markdown_and_json_hold_every_row():
    lines = TABLE.markdown().splitlines()
    assert lines[:5] == ["## title", "", "| method | F |", "|---|---:|", "| a | 0.50 ! |"]
    assert "| b | **0.75 !** |" in lines
    assert "a note" in lines
    rows = json.loads(TABLE.json())
    assert rows[1] == {"name": "b", "score": 0.751}
    assert rows[-1]["score"] is None


def test_it_is_printed_with_title_and_notes(capsys):
    TABLE.print()
    printed = capsys.readouterr().out
    assert printed.startswith("title\n")
    assert "a note" in printed

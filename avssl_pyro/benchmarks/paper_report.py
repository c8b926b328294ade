"""The paper's experiment on disk: ``tables.json`` for programs, ``tables.md`` for people."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.benchmarks.comparison import score_runs
from avssl_pyro.benchmarks.condition import ConditionResult
from avssl_pyro.benchmarks.condition_tables import (
    calibration_dicts,
    calibrations,
    coverage_table,
    reliability_table,
    talking_dicts,
    talking_table,
    timing_table,
)
from avssl_pyro.benchmarks.paper_tables import behind, overall_table, paper_tables, sweep_tables
from avssl_pyro.benchmarks.published_results import PAPER_TABLES
from avssl_pyro.evaluation.report import markdown, row_dict
from avssl_pyro.evaluation.tables import ResultRow, ResultTable

FORMAT = "avssl-tables/1"
NOWHERE_BEHIND = "Nowhere: amortized is at the paper's figure and refined ahead of every baseline in every cell run."


@dataclass(frozen=True)
class ExperimentReport:
    """Cells and the rows scored from them.

    Args:
        cells: all that were run.
        rows: their scores at every tolerance.
        settings: how they were run, as JSON values.
    """

    cells: tuple[ConditionResult, ...]
    rows: tuple[ResultRow, ...]
    settings: dict[str, Any]

    def terminal_tables(self) -> list[ResultTable]:
        """What is worth a screen."""
        found = calibrations(self.cells)
        return [
            *paper_tables(self.rows),
            overall_table(self.rows),
            *sweep_tables(self.rows),
            coverage_table(found),
            talking_table(self.cells),
            timing_table(self.cells),
        ]

    def behind(self) -> list[str]:
        """The cells in which we are behind, one sentence each."""
        return behind(self.rows)

    def write(self, folder: Path) -> None:
        """Writes ``tables.json`` and ``tables.md``; each appears whole or not at all.

        Raises:
            OSError: the folder cannot be written to.
        """
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(folder / "tables.json", f"{json.dumps(self._data(), indent=1, allow_nan=False)}\n".encode())
        write_atomically(folder / "tables.md", self._markdown().encode())

    def _data(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "settings": self.settings,
            "rows": [row_dict(row) for row in self.rows],
            "paper": [
                {
                    "table": table.number,
                    "measure": table.measure,
                    "condition": table.condition,
                    "method": method,
                    "microphones": microphones,
                    "sources": talkers,
                    "value": figure,
                }
                for table in PAPER_TABLES
                for method, figures in table.figures.items()
                for (microphones, talkers), figure in figures.items()
            ],
            "runs": [
                {
                    "condition": cell.condition,
                    "array": cell.array,
                    "microphones": cell.microphones,
                    "method": run.name,
                    "ms_per_clip": None if math.isnan(run.ms_per_clip) else run.ms_per_clip,
                    "setting": None if run.tuned is None else run.tuned.setting,
                    "validation_f_measure": None if run.tuned is None else run.tuned.f_measure,
                    "validation_count_accuracy": None if run.tuned is None else run.tuned.count_accuracy,
                }
                for cell in self.cells
                for run in cell.runs.methods
            ],
            "calibration": calibration_dicts(calibrations(self.cells)),
            "talking": talking_dicts(self.cells),
            "behind": self.behind(),
        }

    def _markdown(self) -> str:
        sentences = [f"- {sentence}" for sentence in self.behind()] or [NOWHERE_BEHIND]
        tables = [*self.terminal_tables(), reliability_table(calibrations(self.cells))]
        return "\n".join(
            [
                "# The paper's tables\n",
                *(markdown(table) for table in tables),
                "![ROC curves of the level](roc.png)\n",
                "## Where we are behind\n",
                *sentences,
                "",
                "## Settings\n",
                "```json",
                json.dumps(self.settings, indent=1),
                "```",
                "",
            ]
        )


def score_cells(cells: Sequence[ConditionResult], settings: dict[str, Any]) -> ExperimentReport:
    """Scores all methods of all cells at every tolerance."""
    rows = [row for cell in cells for row in score_runs(cell.runs, cell.condition, cell.microphones)]
    return ExperimentReport(tuple(cells), tuple(rows), settings)

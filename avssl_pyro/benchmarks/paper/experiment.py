"""The paper's experiment: every condition with every array, stored cell by cell, as tables.json and tables.md."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.benchmarks.cache import ResultCache
from avssl_pyro.benchmarks.comparison import MethodSuite, score_runs
from avssl_pyro.benchmarks.condition import (
    ConditionResult,
    calibration_dicts,
    coverage_table,
    judge_posteriors,
    reliability_table,
    run_condition,
    talking_dicts,
    talking_table,
    timing_table,
)
from avssl_pyro.benchmarks.paper.paper_tables import behind, overall_table, paper_tables, sweep_tables
from avssl_pyro.benchmarks.paper.published_results import ALL_SPEAK, PAPER_TABLES, SOME_SILENT
from avssl_pyro.benchmarks.result_tables import HEADLINE_TOLERANCE_DEG, ResultRow
from avssl_pyro.datasets.builtin import TEST, VALIDATION, Split
from avssl_pyro.datasets.dataset import LabeledClips
from avssl_pyro.evaluation.tables import Table, print_tables, row_dict
from avssl_pyro.viz.plots import Curve, save_roc

CONDITIONS = (ALL_SPEAK, SOME_SILENT)
FORMAT = "avssl-tables/1"
CELL_FORMAT = "avssl-cell/4"
NOWHERE_BEHIND = "Nowhere: amortized is at the paper's figure and refined ahead of every baseline in every cell run."

ScenesOf = Callable[[str, Split, MicrophoneArray], LabeledClips]
"""Scenes of a condition and a split, read as an array."""


@dataclass(frozen=True)
class PaperReport:
    """Cells and the rows scored from them.

    Args:
        cells: all cells that were run.
        rows: their scores at every tolerance.
        settings: settings of the run, as JSON values.
    """

    cells: tuple[ConditionResult, ...]
    rows: tuple[ResultRow, ...]
    settings: dict[str, Any]

    def tables(self) -> list[Table[Any]]:
        """Tables for a terminal."""
        judged = judge_posteriors(self.cells)
        return [
            *paper_tables(self.rows),
            overall_table(self.rows),
            *sweep_tables(self.rows),
            coverage_table(judged),
            talking_table(judged),
            timing_table(self.cells),
        ]

    def behind(self) -> list[str]:
        """Cells below the paper or a baseline, one sentence each."""
        return behind(self.rows)

    def write(self, folder: Path) -> None:
        """Writes ``tables.json``, ``tables.md`` and ``roc.png``; each appears whole or not at all.

        Raises:
            OSError: the folder cannot be written to.
        """
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(folder / "tables.json", f"{json.dumps(self._data(), indent=1, allow_nan=False)}\n".encode())
        write_atomically(folder / "tables.md", self._markdown().encode())
        save_roc(folder / "roc.png", _roc_panels(self.cells))

    def print(self) -> None:
        """Prints the tables, and the cells below the paper or a baseline."""
        print_tables(self.tables())
        print("Where we are behind:")
        for sentence in self.behind() or [NOWHERE_BEHIND]:
            print(f"  {sentence}")

    def _data(self) -> dict[str, Any]:
        judged = judge_posteriors(self.cells)
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
            "calibration": calibration_dicts(judged),
            "talking": talking_dicts(judged),
            "behind": self.behind(),
        }

    def _markdown(self) -> str:
        sentences = [f"- {sentence}" for sentence in self.behind()] or [NOWHERE_BEHIND]
        tables = [*self.tables(), reliability_table(judge_posteriors(self.cells))]
        return "\n".join(
            [
                "# The paper's tables\n",
                *(table.markdown() for table in tables),
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


def score_cells(cells: Sequence[ConditionResult], settings: dict[str, Any]) -> PaperReport:
    """Scores of all methods of all cells at every tolerance."""
    rows = [row for cell in cells for row in score_runs(cell.runs, cell.condition, cell.microphones)]
    return PaperReport(tuple(cells), tuple(rows), settings)


def run_paper(suites: Sequence[MethodSuite], scenes_of: ScenesOf, folder: Path) -> PaperReport:
    """Runs what is not yet in ``folder/cells``, and writes the report into the folder.

    Raises:
        InputError, OSError: a scene cannot be read, a stored cell is damaged, or a file cannot be written.
    """
    cache = ResultCache(folder / "cells", ConditionResult, CELL_FORMAT)
    cells: list[ConditionResult] = []
    settings: list[dict[str, Any]] = []
    places = [(condition, suite) for condition in CONDITIONS for suite in suites]
    # Opened before anything is run, so that a missing folder is reported at once and not after the first cell.
    sets = [
        tuple(scenes_of(condition, split, suite.system.config.array) for split in (VALIDATION, TEST))
        for condition, suite in places
    ]
    for number, ((condition, suite), (validation, test)) in enumerate(zip(places, sets, strict=True), start=1):
        array = suite.system.config.array
        name = f"{condition}-M{array.num_microphones}"
        facts = {
            **suite.settings(),
            "validation": validation.fingerprint,
            "test": test.fingerprint,
            "tuning_tolerance_deg": HEADLINE_TOLERANCE_DEG,
        }
        stored = cache.path(name, facts)
        state = "kept from before" if stored.exists() else f"{len(validation)} validation and {len(test)} test scenes"
        print(f"{condition}, array '{array.name}' (cell {number} of {len(places)}): {state}.", flush=True)
        cells.append(cache.get_or_run(name, facts, partial(_run, condition, suite, validation, test)))
        settings.append({"condition": condition, "array": array.name, "cell": stored.name, **facts})
    report = score_cells(cells, {"cells": settings})
    report.write(folder)
    return report


def _run(condition: str, suite: MethodSuite, validation: LabeledClips, test: LabeledClips) -> ConditionResult:
    return run_condition(condition, suite.system.config.array, suite.methods(), validation, test)


def _roc_panels(cells: Sequence[ConditionResult]) -> dict[str, dict[str, Curve]]:
    silent = [cell for cell in cells if cell.condition == SOME_SILENT]
    panels: dict[str, dict[str, Curve]] = {f"M = {cell.microphones}": {} for cell in silent}
    for one in judge_posteriors(silent):
        if one.curve is not None and one.posterior.silent:
            label = f"{one.posterior.method}, area {one.curve.area:.3f}"
            panels[f"M = {one.cell.microphones}"][label] = (one.curve.false_alarms_p, one.curve.hits_p)
    return panels

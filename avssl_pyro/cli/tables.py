"""The paper's experiment: every condition with every array, each cell kept as soon as it is finished."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.benchmarks.condition import ConditionResult, run_cell
from avssl_pyro.benchmarks.condition_cache import ConditionCache
from avssl_pyro.benchmarks.condition_tables import roc_curves
from avssl_pyro.benchmarks.method_suite import MethodSuite
from avssl_pyro.benchmarks.paper_report import NOWHERE_BEHIND, ExperimentReport, score_cells
from avssl_pyro.benchmarks.published_results import ALL_SPEAK, SOME_SILENT
from avssl_pyro.datasets.builtin import TEST, VALIDATION, Split
from avssl_pyro.datasets.labeled_scenes import LabeledScenes
from avssl_pyro.evaluation.report import print_tables
from avssl_pyro.evaluation.tables import HEADLINE_TOLERANCE_DEG
from avssl_pyro.viz.roc import Curve, save_roc

CONDITIONS = (ALL_SPEAK, SOME_SILENT)

ScenesOf = Callable[[str, Split, MicrophoneArray], LabeledScenes]
"""Scenes of a condition and a split, read as an array."""


def make_tables(line_ups: Sequence[MethodSuite], scenes_of: ScenesOf, out: Path) -> None:
    """Runs what is not yet in ``out/cells``, prints the tables and writes tables.json, tables.md and roc.png.

    Raises:
        InputError, OSError: a scene cannot be read, a kept cell is damaged, or a file cannot be written.
    """
    store = ConditionCache(out / "cells")
    cells: list[ConditionResult] = []
    settings: list[dict[str, Any]] = []
    places = [(condition, line_up) for condition in CONDITIONS for line_up in line_ups]
    # Opened before anything is run, so that a missing folder is told at once and not after the first cell.
    sets = [
        tuple(scenes_of(condition, split, line_up.system.config.array) for split in (VALIDATION, TEST))
        for condition, line_up in places
    ]
    for number, ((condition, line_up), (validation, test)) in enumerate(zip(places, sets, strict=True), start=1):
        array = line_up.system.config.array
        name = f"{condition}-M{array.num_microphones}"
        facts = {
            **line_up.facts(),
            "validation": validation.fingerprint,
            "test": test.fingerprint,
            "tuning_tolerance_deg": HEADLINE_TOLERANCE_DEG,
        }
        kept = store.path(name, facts)
        state = "kept from before" if kept.exists() else f"{len(validation)} validation and {len(test)} test scenes"
        print(f"{condition}, array '{array.name}' (cell {number} of {len(places)}): {state}.", flush=True)
        cells.append(store.get_or_run(name, facts, partial(_run, condition, line_up, validation, test)))
        settings.append({"condition": condition, "array": array.name, "cell": kept.name, **facts})
    report = score_cells(cells, {"cells": settings})
    report.write(out)
    save_roc(out / "roc.png", _roc_panels(cells))
    _print(report, out)


def _run(condition: str, line_up: MethodSuite, validation: LabeledScenes, test: LabeledScenes) -> ConditionResult:
    return run_cell(condition, line_up.system.config.array, line_up.methods(), validation, test)


def _roc_panels(cells: Sequence[ConditionResult]) -> dict[str, dict[str, Curve]]:
    panels: dict[str, dict[str, Curve]] = {
        f"M = {cell.microphones}": {} for cell in cells if cell.condition == SOME_SILENT
    }
    for (condition, microphones, method), curve in roc_curves(cells).items():
        if condition == SOME_SILENT and curve is not None:
            label = f"{method}, area {curve.area:.3f}"
            panels[f"M = {microphones}"][label] = (curve.false_alarms_p, curve.hits_p)
    return panels


def _print(report: ExperimentReport, out: Path) -> None:
    print_tables(report.terminal_tables())
    print("Where we are behind:")
    for sentence in report.behind() or [NOWHERE_BEHIND]:
        print(f"  {sentence}")
    print(f"{out / 'tables.md'}: written, and tables.json and roc.png beside it.")

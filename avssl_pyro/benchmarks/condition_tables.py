"""What cells tell beyond localization scores: calibration, talking people by level, and time."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from avssl_pyro.benchmarks.condition import ConditionResult
from avssl_pyro.evaluation.activity_roc import WITHIN_DEG, RocCurve, roc_curve
from avssl_pyro.evaluation.spread_calibration import GATE_DEG, Calibration, calibrate
from avssl_pyro.evaluation.tables import ResultTable, TableCell, order_methods

CalibrationKey = tuple[str, int, str]
"""Condition, microphones, method."""


def calibrations(cells: Iterable[ConditionResult]) -> dict[CalibrationKey, Calibration]:
    """Calibration of every method's azimuth spread in every cell."""
    return {
        (cell.condition, cell.microphones, belief.method): calibrate(belief.validation, belief.test)
        for cell in cells
        for belief in cell.beliefs
    }


def roc_curves(cells: Iterable[ConditionResult]) -> dict[CalibrationKey, RocCurve | None]:
    """How levels tell talkers from silent people, in cells with silent people."""
    return {
        (cell.condition, cell.microphones, belief.method): roc_curve(belief.talking, belief.silent)
        for cell in cells
        for belief in cell.beliefs
        if belief.silent
    }


def _texts(*texts: str) -> tuple[TableCell, ...]:
    return tuple(TableCell(text) for text in texts)


def _number(value: float, decimals: int = 2) -> str:
    return "–" if math.isnan(value) else f"{value:.{decimals}f}"


def coverage_table(found: dict[CalibrationKey, Calibration]) -> ResultTable:
    """Shares of matched sources within one and two predicted standard deviations, before and after scaling."""
    lines = tuple(
        (
            f"{condition} M={microphones} {method}",
            _texts(
                str(calibration.sources),
                *map(_number, (calibration.within_one, calibration.within_two, calibration.scale)),
                *map(_number, (calibration.scaled_one, calibration.scaled_two)),
            ),
        )
        for (condition, microphones, method), calibration in found.items()
    )
    notes = (
        f"Share of matched sources (within {GATE_DEG:g}°) whose azimuth error is at most 1 or 2 azimuth_std; a normal "
        "distribution has 0.68 and 0.95. The scale was fitted on the validation scenes, the shares are of test scenes.",
    )
    columns = ("sources", "1 std", "2 std", "scale", "1 scaled", "2 scaled")
    return ResultTable("Does azimuth_std cover?", columns, lines, notes, corner="cell")


def reliability_table(found: dict[CalibrationKey, Calibration]) -> ResultTable:
    """Predicted against observed spread, by bins of predicted spread, degrees."""
    lines = tuple(
        (
            f"{condition} M={microphones} {method}",
            _texts(
                f"{np.rad2deg(part.low):.1f} to {np.rad2deg(part.high):.1f}",
                _number(float(np.rad2deg(part.predicted)), 1),
                _number(float(np.rad2deg(part.observed)), 1),
                _number(part.within_one),
                str(part.sources),
            ),
        )
        for (condition, microphones, method), calibration in found.items()
        for part in calibration.bins
    )
    note = "Root mean squares in degrees, of test scenes, unscaled; one line per bin with about equally many sources."
    columns = ("azimuth_std °", "predicted °", "observed °", "1 std", "sources")
    return ResultTable("Predicted and observed azimuth errors", columns, lines, (note,), corner="cell")


def talking_table(cells: Sequence[ConditionResult]) -> ResultTable:
    """Area under the ROC curve of telling talkers from silent people by level, per array."""
    with_silent = [cell for cell in cells if any(belief.silent for belief in cell.beliefs)]
    curves = roc_curves(with_silent)
    lines = tuple(
        (
            method,
            tuple(
                TableCell("–" if curve is None else f"{curve.area:.3f}")
                for cell in with_silent
                for curve in [curves.get((cell.condition, cell.microphones, method))]
            ),
        )
        for method in order_methods(belief.method for cell in with_silent for belief in cell.beliefs)
    )
    people = [
        f"{cell.condition} M={cell.microphones}: {len(first.talking)} talking, {len(first.silent)} silent people"
        for cell in with_silent
        for first in cell.beliefs[:1]
    ]
    notes = (
        "Area under the ROC curve; 0.5 is chance. A person has the level of the nearest source class within "
        f"{WITHIN_DEG:g}°, diffuse ones aside, and 0 without one.",
        *(["; ".join(people) + "."] if people else []),
    )
    columns = tuple(f"{cell.condition} M={cell.microphones}" for cell in with_silent)
    return ResultTable("Does the level tell who talks?", columns, lines, notes)


def timing_table(cells: Sequence[ConditionResult]) -> ResultTable:
    """Wall-clock milliseconds per test clip."""
    times = {
        (cell.condition, cell.microphones, run.name): run.ms_per_clip for cell in cells for run in cell.runs.methods
    }
    methods = order_methods(name for (_, _, name), ms in times.items() if not math.isnan(ms))
    lines = tuple(
        (
            method,
            _texts(*(_number(times.get((cell.condition, cell.microphones, method), math.nan), 1) for cell in cells)),
        )
        for method in methods
    )
    note = "Wall-clock time; the baselines share the clips among their processes, the networks use torch's threads."
    columns = tuple(f"{cell.condition} M={cell.microphones}" for cell in cells)
    return ResultTable("Milliseconds per test clip", columns, lines, (note,))


def calibration_dicts(found: dict[CalibrationKey, Calibration]) -> list[dict[str, Any]]:
    """Calibrations as JSON values, angles in degrees, NaN as null."""
    return [
        {
            "condition": condition,
            "microphones": microphones,
            "method": method,
            "gate_deg": GATE_DEG,
            "sources": calibration.sources,
            "within_one_std": _or_none(calibration.within_one),
            "within_two_std": _or_none(calibration.within_two),
            "scale_fitted_on_validation": _or_none(calibration.scale),
            "within_one_scaled_std": _or_none(calibration.scaled_one),
            "within_two_scaled_std": _or_none(calibration.scaled_two),
            "bins": [
                {
                    "azimuth_std_deg": [float(np.rad2deg(part.low)), float(np.rad2deg(part.high))],
                    "predicted_deg": float(np.rad2deg(part.predicted)),
                    "observed_deg": float(np.rad2deg(part.observed)),
                    "within_one_std": part.within_one,
                    "sources": part.sources,
                }
                for part in calibration.bins
            ],
        }
        for (condition, microphones, method), calibration in found.items()
    ]


def talking_dicts(cells: Iterable[ConditionResult]) -> list[dict[str, Any]]:
    """Areas under the ROC curves as JSON values, null where there is none."""
    dicts = []
    for cell in cells:
        for belief in cell.beliefs:
            if belief.silent:
                curve = roc_curve(belief.talking, belief.silent)
                dicts.append(
                    {
                        "condition": cell.condition,
                        "microphones": cell.microphones,
                        "method": belief.method,
                        "area": None if curve is None else curve.area,
                        "talking": len(belief.talking),
                        "silent": len(belief.silent),
                        "within_deg": WITHIN_DEG,
                    }
                )
    return dicts


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value

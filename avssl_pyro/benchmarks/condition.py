"""One cell of the paper's experiment, a condition and an array: results of all methods, and tables of many cells."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.benchmarks.comparison import LabeledClip, Observations, Runs, observe_scenes, tune_and_decide
from avssl_pyro.benchmarks.result_tables import order_methods
from avssl_pyro.evaluation.activity_roc import WITHIN_DEG, RocCurve, levels_of, roc_curve
from avssl_pyro.evaluation.methods import Method, PosteriorMethod
from avssl_pyro.evaluation.spread_calibration import (
    GATE_DEG,
    Calibration,
    ReliabilityBin,
    SpreadErrors,
    calibrate,
    match_spreads,
)
from avssl_pyro.evaluation.tables import Column, Table
from avssl_pyro.localization.direct_level import DirectLevelRule

POSTERIOR_METHODS = ("amortized", "refined")


@dataclass(frozen=True)
class StoredPosterior:
    """Spreads and levels of a method's posteriors, by which they are judged.

    Args:
        method: name of the method.
        validation, test: errors and predicted spreads of matched sources.
        talking, silent: levels of all people of the test scenes who talk, and who do not.
    """

    method: str
    validation: SpreadErrors
    test: SpreadErrors
    talking: tuple[float, ...]
    silent: tuple[float, ...]


@dataclass(frozen=True)
class ConditionResult:
    """Results of all methods on one condition with one array."""

    condition: str
    array: str
    microphones: int
    runs: Runs
    posteriors: tuple[StoredPosterior, ...]

    @property
    def name(self) -> str:
        """Condition and number of microphones, as tables show them."""
        return f"{self.condition} M={self.microphones}"


def run_condition(
    condition: str,
    array: MicrophoneArray,
    methods: Sequence[Method[Any, Any]],
    validation: Iterable[LabeledClip],
    test: Iterable[LabeledClip],
    posterior_methods: Sequence[str] = POSTERIOR_METHODS,
) -> ConditionResult:
    """Tunes on validation scenes, applies to test scenes, and stores the posteriors of ``posterior_methods``.

    Raises:
        InputError: either set is empty, or a method cannot read a clip.
    """
    where = f"{condition} M={array.num_microphones}"
    tuning = observe_scenes(methods, validation, f"{where} validation")
    testing = observe_scenes(methods, test, f"{where} test")
    runs = tune_and_decide(methods, tuning, testing)
    settings = {run.name: run.tuned.setting for run in runs.methods if run.tuned is not None}
    posteriors = tuple(
        _stored(method, settings[method.name], tuning, testing, index)
        for index, method in enumerate(methods)
        if isinstance(method, PosteriorMethod) and method.name in posterior_methods
    )
    return ConditionResult(condition, array.name, array.num_microphones, runs, posteriors)


def _stored(
    method: PosteriorMethod, setting: DirectLevelRule, tuning: Observations, testing: Observations, index: int
) -> StoredPosterior:
    def spread(observed: Observations) -> SpreadErrors:
        posteriors = observed.by_method[index]
        return match_spreads(observed.references, [setting.select(p, method.grid) for p in posteriors])

    talking: list[float] = []
    silent: list[float] = []
    for labels, posterior in zip(testing.labels, testing.by_method[index], strict=True):
        talking.extend(map(float, levels_of(labels.talker_azimuths, posterior, method.grid)))
        silent.extend(map(float, levels_of(labels.silent_azimuths, posterior, method.grid)))
    return StoredPosterior(method.name, spread(tuning), spread(testing), tuple(talking), tuple(silent))


@dataclass(frozen=True)
class Judged:
    """One method's posteriors in one cell: calibration of azimuths, and ROC curve of levels.

    Args:
        cell: condition and array.
        posterior: what is judged.
        calibration: of the spread of azimuths.
        curve: of detecting talkers by level; None without silent people.
    """

    cell: ConditionResult
    posterior: StoredPosterior
    calibration: Calibration
    curve: RocCurve | None

    @property
    def name(self) -> str:
        """Condition, number of microphones and method, as tables show them."""
        return f"{self.cell.name} {self.posterior.method}"


def judge_posteriors(cells: Iterable[ConditionResult]) -> list[Judged]:
    """Calibration and ROC curve of every method's posteriors in every cell."""
    return [
        Judged(cell, stored, calibrate(stored.validation, stored.test), roc_curve(stored.talking, stored.silent))
        for cell in cells
        for stored in cell.posteriors
    ]


def coverage_table(judged: Sequence[Judged]) -> Table[Judged]:
    """Shares of matched sources within one and two predicted standard deviations, before and after scaling."""
    columns: list[Column[Judged]] = [
        Column("cell", lambda one: one.name),
        Column("sources", lambda one: one.calibration.sources),
        Column("1 std", lambda one: one.calibration.within_one, "{:.2f}"),
        Column("2 std", lambda one: one.calibration.within_two, "{:.2f}"),
        Column("scale", lambda one: one.calibration.scale, "{:.2f}"),
        Column("1 scaled", lambda one: one.calibration.scaled_one, "{:.2f}"),
        Column("2 scaled", lambda one: one.calibration.scaled_two, "{:.2f}"),
    ]
    notes = (
        f"Share of matched sources (within {GATE_DEG:g}°) whose azimuth error is at most 1 or 2 azimuth_std; a normal "
        "distribution has 0.68 and 0.95. The scale was fitted on the validation scenes, the shares are of test scenes.",
    )
    return Table(judged, columns, "Does azimuth_std cover?", notes)


def reliability_table(judged: Sequence[Judged]) -> Table[tuple[str, ReliabilityBin]]:
    """Predicted against observed spread, by bins of predicted spread, degrees."""
    columns: list[Column[tuple[str, ReliabilityBin]]] = [
        Column("cell", lambda row: row[0]),
        Column("azimuth_std °", lambda row: f"{np.rad2deg(row[1].low):.1f} to {np.rad2deg(row[1].high):.1f}"),
        Column("predicted °", lambda row: float(np.rad2deg(row[1].predicted)), "{:.1f}"),
        Column("observed °", lambda row: float(np.rad2deg(row[1].observed)), "{:.1f}"),
        Column("1 std", lambda row: row[1].within_one, "{:.2f}"),
        Column("sources", lambda row: row[1].sources),
    ]
    rows = [(one.name, part) for one in judged for part in one.calibration.bins]
    note = "Root mean squares in degrees, of test scenes, unscaled; one line per bin with about equally many sources."
    return Table(rows, columns, "Predicted and observed azimuth errors", (note,))


def talking_table(judged: Sequence[Judged]) -> Table[str]:
    """Area under the ROC curve of detecting talkers by level, per method and array."""
    with_silent = [one for one in judged if one.posterior.silent]
    cells = {one.cell.name: one.posterior for one in reversed(with_silent)}
    areas = {(one.posterior.method, one.cell.name): one.curve.area for one in with_silent if one.curve is not None}
    names = list(reversed(cells))
    columns: list[Column[str]] = [
        Column("method", str),
        *(Column(name, partial(_of_cell, areas, name), "{:.3f}") for name in names),
    ]
    people = [f"{name}: {len(cells[name].talking)} talking, {len(cells[name].silent)} silent people" for name in names]
    notes = (
        "Area under the ROC curve; 0.5 is chance. The level of a person is that of the nearest source class within "
        f"{WITHIN_DEG:g}°, diffuse ones aside, and 0 without one.",
        *(["; ".join(people) + "."] if people else []),
    )
    methods = order_methods(one.posterior.method for one in with_silent)
    return Table(methods, columns, "Does the level tell who talks?", notes)


def _of_cell(values: Mapping[tuple[str, str], float], cell: str, method: str) -> float | None:
    return values.get((method, cell))


def timing_table(cells: Sequence[ConditionResult]) -> Table[str]:
    """Wall-clock milliseconds per test clip."""
    times = {(run.name, cell.name): run.ms_per_clip for cell in cells for run in cell.runs.methods}
    columns: list[Column[str]] = [
        Column("method", str),
        *(
            Column(name, partial(_of_cell, times, name), "{:.1f}")
            for name in dict.fromkeys(cell.name for cell in cells)
        ),
    ]
    methods = order_methods(name for (name, _), ms in times.items() if not math.isnan(ms))
    note = "Wall-clock time; the baselines share the clips among their processes, the networks use torch's threads."
    return Table(methods, columns, "Milliseconds per test clip", (note,))


def calibration_dicts(judged: Iterable[Judged]) -> list[dict[str, Any]]:
    """Calibrations as JSON values, angles in degrees, NaN as null."""
    return [
        {
            "condition": one.cell.condition,
            "microphones": one.cell.microphones,
            "method": one.posterior.method,
            "gate_deg": GATE_DEG,
            "sources": one.calibration.sources,
            "within_one_std": _or_none(one.calibration.within_one),
            "within_two_std": _or_none(one.calibration.within_two),
            "scale_fitted_on_validation": _or_none(one.calibration.scale),
            "within_one_scaled_std": _or_none(one.calibration.scaled_one),
            "within_two_scaled_std": _or_none(one.calibration.scaled_two),
            "bins": [
                {
                    "azimuth_std_deg": [float(np.rad2deg(part.low)), float(np.rad2deg(part.high))],
                    "predicted_deg": float(np.rad2deg(part.predicted)),
                    "observed_deg": float(np.rad2deg(part.observed)),
                    "within_one_std": part.within_one,
                    "sources": part.sources,
                }
                for part in one.calibration.bins
            ],
        }
        for one in judged
    ]


def talking_dicts(judged: Iterable[Judged]) -> list[dict[str, Any]]:
    """Areas under the ROC curves as JSON values, null where there is none."""
    return [
        {
            "condition": one.cell.condition,
            "microphones": one.cell.microphones,
            "method": one.posterior.method,
            "area": None if one.curve is None else one.curve.area,
            "talking": len(one.posterior.talking),
            "silent": len(one.posterior.silent),
            "within_deg": WITHIN_DEG,
        }
        for one in judged
        if one.posterior.silent
    ]


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value

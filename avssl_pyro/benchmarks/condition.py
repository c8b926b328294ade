"""One cell of the paper's experiment, a condition and an array: everything found there, as it is kept on disk."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.benchmarks.comparison import MethodRun, Observations, Runs, Scene, observe, tune_and_decide
from avssl_pyro.benchmarks.posterior_method import PosteriorMethod
from avssl_pyro.evaluation.activity_roc import levels_of
from avssl_pyro.evaluation.methods import Method, Tuned
from avssl_pyro.evaluation.spread_calibration import SpreadErrors, match_spreads
from avssl_pyro.localization.posterior import SourceThresholds, select_sources

BELIEVERS = ("amortized", "refined")


@dataclass(frozen=True)
class StoredPosterior:
    """What a method's stated certainty and levels are judged by.

    Args:
        method: its name.
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
    beliefs: tuple[StoredPosterior, ...]


def run_cell(
    condition: str,
    array: MicrophoneArray,
    methods: Sequence[Method[Any, Any]],
    validation: Iterable[Scene],
    test: Iterable[Scene],
    believers: Sequence[str] = BELIEVERS,
) -> ConditionResult:
    """Tunes on validation scenes, applies to test scenes, and takes down what the ``believers`` said of themselves.

    Raises:
        InputError: either set is empty, or a method cannot read a clip.
    """
    where = f"{condition} M={array.num_microphones}"
    tuning = observe(methods, validation, f"{where} validation")
    testing = observe(methods, test, f"{where} test")
    runs = tune_and_decide(methods, tuning, testing)
    settings = {run.name: run.tuned.setting for run in runs.methods if run.tuned is not None}
    beliefs = tuple(
        _belief(method, settings[method.name], tuning, testing, index)
        for index, method in enumerate(methods)
        if isinstance(method, PosteriorMethod) and method.name in believers
    )
    return ConditionResult(condition, array.name, array.num_microphones, runs, beliefs)


def _belief(
    method: PosteriorMethod, setting: SourceThresholds, tuning: Observations, testing: Observations, index: int
) -> StoredPosterior:
    def spread(observed: Observations) -> SpreadErrors:
        posteriors = observed.by_method[index]
        return match_spreads(observed.references, [select_sources(p, method.grid, setting) for p in posteriors])

    talking: list[float] = []
    silent: list[float] = []
    for labels, posterior in zip(testing.labels, testing.by_method[index], strict=True):
        talking.extend(levels_of(labels.talker_azimuths, posterior, method.grid, setting.peak))
        silent.extend(levels_of(labels.silent_azimuths, posterior, method.grid, setting.peak))
    return StoredPosterior(method.name, spread(tuning), spread(testing), tuple(talking), tuple(silent))


def cell_to_dict(cell: ConditionResult) -> dict[str, Any]:
    """A cell as JSON values, angles in degrees; settings become plain dictionaries."""
    return {
        "condition": cell.condition,
        "array": cell.array,
        "microphones": cell.microphones,
        "references_deg": [_degrees(truth) for truth in cell.runs.references],
        "methods": [
            {
                "name": run.name,
                "estimates_deg": [_degrees(estimate) for estimate in run.estimates],
                "tuned": None if run.tuned is None else _tuned_to_dict(run.tuned),
                "ms_per_clip": None if np.isnan(run.ms_per_clip) else run.ms_per_clip,
            }
            for run in cell.runs.methods
        ],
        "beliefs": [
            {
                "method": belief.method,
                "validation": _spread_to_dict(belief.validation),
                "test": _spread_to_dict(belief.test),
                "talking": list(map(float, belief.talking)),
                "silent": list(map(float, belief.silent)),
            }
            for belief in cell.beliefs
        ],
    }


def cell_from_dict(data: Any) -> ConditionResult:
    """The inverse of :func:`cell_to_dict`, except that settings stay dictionaries.

    Raises:
        KeyError, TypeError, ValueError: ``data`` is something else.
    """
    methods = tuple(
        MethodRun(
            name=run["name"],
            estimates=tuple(_radians(estimate) for estimate in run["estimates_deg"]),
            tuned=None if run["tuned"] is None else Tuned(**run["tuned"]),
            ms_per_clip=float("nan") if run["ms_per_clip"] is None else float(run["ms_per_clip"]),
        )
        for run in data["methods"]
    )
    beliefs = tuple(
        StoredPosterior(
            belief["method"],
            _spread_from_dict(belief["validation"]),
            _spread_from_dict(belief["test"]),
            tuple(belief["talking"]),
            tuple(belief["silent"]),
        )
        for belief in data["beliefs"]
    )
    references = tuple(_radians(truth) for truth in data["references_deg"])
    return ConditionResult(
        data["condition"], data["array"], int(data["microphones"]), Runs(references, methods), beliefs
    )


def _degrees(angles: npt.ArrayLike) -> list[float]:
    return [float(value) for value in np.rad2deg(np.asarray(angles, dtype=np.float64))]


def _radians(angles_deg: Any) -> npt.NDArray[np.float64]:
    return np.deg2rad(np.array(angles_deg, dtype=np.float64))


def _tuned_to_dict(tuned: Tuned[Any]) -> dict[str, Any]:
    setting = tuned.setting if isinstance(tuned.setting, dict) else asdict(tuned.setting)
    return {"setting": setting, "f_measure": tuned.f_measure, "count_accuracy": tuned.count_accuracy}


def _spread_to_dict(spread: SpreadErrors) -> dict[str, list[float]]:
    return {"errors_deg": _degrees(spread.errors_p), "stds_deg": _degrees(spread.stds_p)}


def _spread_from_dict(data: Any) -> SpreadErrors:
    return SpreadErrors(_radians(data["errors_deg"]), _radians(data["stds_deg"]))

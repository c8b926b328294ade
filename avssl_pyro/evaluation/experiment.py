"""The comparison: every method tuned on validation scenes, applied to test scenes, and scored beside trivial rows."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.data.clip import Clip, SceneLabels
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.matching import Matching, gate_then_assign
from avssl_pyro.evaluation.methods import Method, Tuned, tune
from avssl_pyro.evaluation.metrics import Azimuths, bootstrap_f_measure, summarize, tally
from avssl_pyro.evaluation.tables import HEADLINE_TOLERANCE_DEG, ResultRow
from avssl_pyro.evaluation.trivial import TRIVIAL_ROWS, TrivialRow

Scene = tuple[Clip, SceneLabels]
TOLERANCES_DEG = (5.0, 10.0, 15.0, 20.0)
SCENES_AT_A_TIME = 64


@dataclass(frozen=True)
class MethodRun:
    """What one method made of the test scenes.

    Args:
        name: of the method.
        estimates: azimuths per test clip, radians.
        tuned: the setting used and its validation scores; None for a trivial row.
        ms_per_clip: wall-clock time of the observation of a test clip, milliseconds; NaN for a trivial row.
    """

    name: str
    estimates: tuple[Azimuths, ...]
    tuned: Tuned[Any] | None = None
    ms_per_clip: float = float("nan")


@dataclass(frozen=True)
class Runs:
    """Runs of several methods over the same test scenes, whose true azimuths are kept per clip, radians."""

    references: tuple[Azimuths, ...]
    methods: tuple[MethodRun, ...]


@dataclass(frozen=True)
class _Observed:
    references: list[npt.NDArray[np.float64]]
    by_method: list[list[Any]]
    seconds: list[float]


def _observe(methods: Sequence[Method[Any, Any]], scenes: Iterable[Scene], title: str) -> _Observed:
    """Reads the scenes once, a few at a time, and shows their clips to every method."""
    observed = _Observed([], [[] for _ in methods], [0.0] * len(methods))
    total = len(scenes) if isinstance(scenes, Sequence) else None
    with tqdm(total=total, desc=title, unit="clip") as bar:
        remaining = iter(scenes)
        while chunk := list(islice(remaining, SCENES_AT_A_TIME)):
            clips = [clip for clip, _ in chunk]
            observed.references.extend(np.array(labels.talker_azimuths, dtype=np.float64) for _, labels in chunk)
            for index, method in enumerate(methods):
                bar.set_postfix_str(method.name)
                start = time.perf_counter()
                observed.by_method[index].extend(method.observe_all(clips))
                observed.seconds[index] += time.perf_counter() - start
            bar.update(len(chunk))
    if not observed.references:
        raise InputError(f"{title} scenes: there is not a single one; the comparison needs some.")
    return observed


def run_methods(
    methods: Sequence[Method[Any, Any]],
    validation: Iterable[Scene],
    test: Iterable[Scene],
    tuning_tolerance_deg: float = HEADLINE_TOLERANCE_DEG,
    trivial: Sequence[TrivialRow] = TRIVIAL_ROWS,
) -> Runs:
    """Tunes every method on the validation scenes and applies it to the test scenes.

    Labels of the validation scenes choose the settings; those of the test scenes are handed to trivial rows only.

    Raises:
        InputError: either set is empty, or a method cannot read a clip.
    """
    tuning = _observe(methods, validation, "validation")
    tuned = [
        tune(method, observations, tuning.references, np.deg2rad(tuning_tolerance_deg))
        for method, observations in zip(methods, tuning.by_method, strict=True)
    ]
    testing = _observe(methods, test, "test")
    clips = len(testing.references)
    runs = [MethodRun(row.name, tuple(row.estimate(tuning.references, testing.references))) for row in trivial]
    for index, method in enumerate(methods):
        setting = tuned[index].setting
        estimates = tuple(method.decide(observation, setting) for observation in testing.by_method[index])
        runs.append(MethodRun(method.name, estimates, tuned[index], 1e3 * testing.seconds[index] / clips))
    return Runs(tuple(testing.references), tuple(runs))


def score_runs(
    runs: Runs,
    condition: str,
    num_microphones: int,
    *,
    tolerances_deg: Sequence[float] = TOLERANCES_DEG,
    matching: Matching = gate_then_assign,
    seed: int = 0,
) -> list[ResultRow]:
    """Rows for every tolerance, method and number of sources that occurs, and for all numbers together."""
    counts_b = np.array([len(truth) for truth in runs.references])
    cells: list[int | str] = [*(int(count) for count in np.unique(counts_b)), "all"]
    rows = []
    for tolerance_deg in tolerances_deg:
        for run in runs.methods:
            tallies = tally(runs.references, run.estimates, np.deg2rad(tolerance_deg), matching)
            for cell in cells:
                scores = summarize(tallies, None if cell == "all" else counts_b == cell)
                interval = bootstrap_f_measure(scores.tallies, seed)
                rows.append(
                    ResultRow(
                        condition=condition,
                        microphones=num_microphones,
                        sources=cell,
                        method=run.name,
                        tolerance_deg=float(tolerance_deg),
                        f_measure=scores.f_measure,
                        precision=scores.precision,
                        recall=scores.recall,
                        count_accuracy=scores.count_accuracy,
                        localization_error_deg=float(np.rad2deg(scores.localization_error)),
                        clips=scores.num_clips,
                        f_low=interval.low,
                        f_high=interval.high,
                    )
                )
    return rows


def compare(
    methods: Sequence[Method[Any, Any]],
    validation: Iterable[Scene],
    test: Iterable[Scene],
    condition: str,
    array: MicrophoneArray,
    *,
    tolerances_deg: Sequence[float] = TOLERANCES_DEG,
) -> list[ResultRow]:
    """:func:`run_methods`, tuned at the headline tolerance, then :func:`score_runs`."""
    runs = run_methods(methods, validation, test)
    return score_runs(runs, condition, array.num_microphones, tolerances_deg=tolerances_deg)

"""Comparison of methods: tuned on validation scenes, applied to test scenes, and scored."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import attrs
import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from avssl_pyro.benchmarks.result_tables import HEADLINE_TOLERANCE_DEG, ResultRow
from avssl_pyro.clip import Clip, SceneLabels
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.baselines import BASELINES, DEFAULT_BAND_HZ, PEAK_SETTINGS, default_baselines
from avssl_pyro.evaluation.chance import CHANCE_ROWS, ChanceRow
from avssl_pyro.evaluation.matching import Matching, gate_then_assign
from avssl_pyro.evaluation.methods import SOURCE_SETTINGS, Method, PosteriorMethod, Tuned, tune
from avssl_pyro.evaluation.metrics import Azimuths, bootstrap_count_accuracy, bootstrap_f_measure, summarize, tally
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.localizer import Localizer, audio_only_refinement
from avssl_pyro.systems.checkpoint import fingerprint, load_checkpoint
from avssl_pyro.systems.system import System

LabeledClip = tuple[Clip, SceneLabels]
TOLERANCES_DEG = (5.0, 10.0, 15.0, 20.0)
SCENES_AT_A_TIME = 64


@dataclass(frozen=True)
class MethodRun:
    """Estimates of one method for the test scenes.

    Args:
        name: name of the method.
        estimates: azimuths per test clip, radians.
        tuned: setting used, with its validation scores; None for a chance row.
        ms_per_clip: wall-clock time of the observation of a test clip, milliseconds; NaN for a chance row.
    """

    name: str
    estimates: tuple[Azimuths, ...]
    tuned: Tuned[Any] | None = None
    ms_per_clip: float = float("nan")


@dataclass(frozen=True)
class Runs:
    """Runs of several methods over the same test scenes; the references are true azimuths per clip, radians."""

    references: tuple[Azimuths, ...]
    methods: tuple[MethodRun, ...]


@dataclass(frozen=True)
class Observations:
    """Observations of several methods on the same scenes.

    Args:
        labels: labels of each clip.
        by_method: per method, one observation per clip.
        seconds: per method, wall-clock time of all its observations.
    """

    labels: list[SceneLabels]
    by_method: list[list[Any]]
    seconds: list[float]

    @property
    def references(self) -> list[npt.NDArray[np.float64]]:
        """True azimuths of the talkers per clip, radians."""
        return [np.array(labels.talker_azimuths, dtype=np.float64) for labels in self.labels]


def observe_scenes(methods: Sequence[Method[Any, Any]], scenes: Iterable[LabeledClip], title: str) -> Observations:
    """Observations of every method, which gets clips and never their labels.

    Raises:
        InputError: there are no scenes (``title`` names them), or a method cannot read a clip.
    """
    observed = Observations([], [[] for _ in methods], [0.0] * len(methods))
    total = len(scenes) if isinstance(scenes, Sequence) else None
    with tqdm(total=total, desc=title, unit="clip") as bar:
        remaining = iter(scenes)
        while chunk := list(islice(remaining, SCENES_AT_A_TIME)):
            clips = [clip for clip, _ in chunk]
            observed.labels.extend(labels for _, labels in chunk)
            for index, method in enumerate(methods):
                bar.set_postfix_str(method.name)
                start = time.perf_counter()
                observed.by_method[index].extend(method.observe_all(clips))
                observed.seconds[index] += time.perf_counter() - start
            bar.update(len(chunk))
    if not observed.labels:
        raise InputError(f"{title} scenes: there are none; give at least one.")
    return observed


def tune_and_decide(
    methods: Sequence[Method[Any, Any]],
    tuning: Observations,
    testing: Observations,
    tuning_tolerance_deg: float = HEADLINE_TOLERANCE_DEG,
    chance: Sequence[ChanceRow] = CHANCE_ROWS,
) -> Runs:
    """Tunes every method on its observations of validation scenes, and applies it to those of test scenes.

    Labels of the validation scenes choose the settings; those of the test scenes are passed to chance rows only.
    """
    known, references = tuning.references, testing.references
    runs = [MethodRun(row.name, tuple(row.estimate(known, references))) for row in chance]
    for index, method in enumerate(tqdm(methods, desc="thresholds", unit="method", leave=False)):
        tuned = tune(method, tuning.by_method[index], known, np.deg2rad(tuning_tolerance_deg))
        estimates = tuple(method.decide(observation, tuned.setting) for observation in testing.by_method[index])
        runs.append(MethodRun(method.name, estimates, tuned, 1e3 * testing.seconds[index] / len(references)))
    return Runs(tuple(references), tuple(runs))


def run_methods(
    methods: Sequence[Method[Any, Any]],
    validation: Iterable[LabeledClip],
    test: Iterable[LabeledClip],
    tuning_tolerance_deg: float = HEADLINE_TOLERANCE_DEG,
    chance: Sequence[ChanceRow] = CHANCE_ROWS,
) -> Runs:
    """Observes both sets of scenes, then :func:`tune_and_decide`.

    Raises:
        InputError: either set is empty, or a method cannot read a clip.
    """
    tuning = observe_scenes(methods, validation, "validation")
    testing = observe_scenes(methods, test, "test")
    return tune_and_decide(methods, tuning, testing, tuning_tolerance_deg, chance)


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
                f_interval = bootstrap_f_measure(scores.tallies, seed)
                count_interval = bootstrap_count_accuracy(scores.tallies, seed)
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
                        f_low=f_interval.low,
                        f_high=f_interval.high,
                        count_low=count_interval.low,
                        count_high=count_interval.high,
                    )
                )
    return rows


def system_band_hz(system: System) -> tuple[float, float]:
    """Band of a system's spectrogram, up to and without the next bin, as pyroomacoustics leaves out the upper end."""
    config = system.config.stft
    frequencies_f = config.frequencies
    return float(frequencies_f[0]), float(frequencies_f[-1] + config.sample_rate / config.window)


@dataclass(frozen=True)
class MethodSuite:
    """Baselines and a trained system on the system's array and grid.

    Args:
        system: system of the rows ``amortized`` and ``refined``.
        without_audio: system of the row ``no-audio-net``, with every mixing level at 1/K.
        refinement: of the rows ``refined`` and ``audio-only refined``; the latter starts without the picture.
        baseline_band_hz: frequencies that the baselines search.
        workers: processes of the baselines; None is one per core.
        device: torch device of the networks.
    """

    system: System
    without_audio: System
    refinement: RefinementConfig
    baseline_band_hz: tuple[float, float] = DEFAULT_BAND_HZ
    workers: int | None = 1
    device: str = "cpu"

    def methods(self) -> list[Method[Any, Any]]:
        """All methods, fresh."""
        config = self.system.config
        grid = config.grid
        localizers = {
            "audio-only refined": Localizer(self.system, self.device, refinement=self.refinement, audio_only=True),
            "no-audio-net": Localizer(self.without_audio, self.device, uniform_levels=True),
            "amortized": Localizer(self.system, self.device),
        }
        localizers["refined"] = Localizer(self.system, self.device, refinement=self.refinement)
        return [
            *default_baselines(config.array, grid, self.workers, self.baseline_band_hz),
            *(PosteriorMethod(name, localizer.posteriors, grid) for name, localizer in localizers.items()),
        ]

    def settings(self) -> dict[str, Any]:
        """Everything that determines the estimates of the methods, as JSON values."""
        return {
            "system": fingerprint(self.system),
            "without_audio": fingerprint(self.without_audio),
            "refinement": attrs.asdict(self.refinement),
            "blind_refinement": attrs.asdict(audio_only_refinement(self.refinement)),
            "baselines": [baseline.name for baseline in BASELINES],
            "baseline_band_hz": list(self.baseline_band_hz),
            "source_settings": [asdict(setting) for setting in SOURCE_SETTINGS],
            "peak_settings": [asdict(setting) for setting in PEAK_SETTINGS],
        }


def make_suites(
    systems: Sequence[System],
    without_audio: Sequence[System],
    refinement: RefinementConfig,
    same_band: bool = False,
    workers: int | None = 1,
    device: str = "cpu",
) -> list[MethodSuite]:
    """A suite for each system.

    Args:
        systems: trained systems.
        without_audio: systems of the row ``no-audio-net``, on arrays of ``systems``; by default those themselves.
        refinement: settings of the refined rows.
        same_band: whether the baselines search the system's own band.
        workers, device: as of :class:`MethodSuite`.

    Raises:
        InputError: the array of a system without audio network is that of no other system.
    """
    arrays = [system.config.array for system in systems]
    for system in without_audio:
        if system.config.array not in arrays:
            raise InputError(
                f"--no-audio-checkpoint: array '{system.config.array.name}' is that of no --checkpoint; give "
                "checkpoints of the same arrays."
            )
    by_array = {system.config.array: system for system in without_audio}
    return [
        MethodSuite(
            system,
            by_array.get(system.config.array, system),
            refinement,
            system_band_hz(system) if same_band else DEFAULT_BAND_HZ,
            workers,
            device,
        )
        for system in systems
    ]


def load_systems(checkpoints: Sequence[Path]) -> list[System]:
    """Systems of some checkpoints, in the order of their number of microphones.

    Raises:
        InputError: two have equally many microphones, or as :func:`load_checkpoint`.
    """
    by_microphones: dict[int, System] = {}
    for path in checkpoints:
        system = load_checkpoint(path)
        microphones = system.config.array.num_microphones
        if microphones in by_microphones:
            raise InputError(
                f"{path}: a second checkpoint for {microphones} microphones; give one for each number of microphones, "
                "and another --out for the others."
            )
        by_microphones[microphones] = system
    return [by_microphones[microphones] for microphones in sorted(by_microphones)]

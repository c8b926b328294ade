"""Scores trained systems beside audio-only baselines on labelled scenes."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import tyro

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.benchmarks.comparison import MethodSuite, run_methods, score_runs, system_band_hz
from avssl_pyro.benchmarks.paper import run_paper
from avssl_pyro.benchmarks.result_tables import print_report, write_report
from avssl_pyro.cli.options import choose_system
from avssl_pyro.datasets.builtin import TEST, VALIDATION, Split, default_dataset
from avssl_pyro.datasets.dataset import LabeledClips, SceneDataset
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.baselines import DEFAULT_BAND_HZ
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.systems.checkpoint import load_checkpoint
from avssl_pyro.systems.config import MOST_GENERAL, PRETRAINED
from avssl_pyro.systems.pretrained import load_weights_of
from avssl_pyro.systems.system import System


@dataclass(frozen=True)
class EvaluateOptions:
    """Precision, recall, F-measure, count accuracy and error of a checkpoint, of MUSIC, NormMUSIC and SRP-PHAT.

    Thresholds of every method are tuned on the validation scenes and applied to the test scenes. With --tables, the
    paper's Tables I-III: both conditions, every array given, the paper's figures beside ours, tolerances, calibration.
    """

    checkpoint: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Checkpoint of svi_train.py (.safetensors); with --tables one per number of microphones, the option repeated. By
    default the weights that come with the package."""
    array: str | None = None
    """Without --tables: preset or YAML file of the array; by default that of the checkpoint, or circle6."""
    out: Path = Path("runs/evaluation")
    """Folder for report.json and report.md, or tables.json, tables.md, roc.png and cells/."""
    tables: bool = False
    """Make the paper's tables. Finished cells are kept in --out: the same command goes on where it stopped."""
    no_audio_checkpoint: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Checkpoints trained with --guide.no-audio-net, one per array; by default the row no-audio-net is the same visual
    network with all mixing levels at 1/K."""
    sets: Path | None = None
    """Folder made of four sets of simulate.py: all-speak-validation, all-speak-test, some-silent-validation and
    some-silent-test; by default small sets made here."""
    validation_data: tuple[Path, ...] = ()
    """Instead of --sets and without --tables: folders of shards to tune thresholds on."""
    test_data: tuple[Path, ...] = ()
    """Instead of --sets and without --tables: folders of shards to score."""
    condition: Literal["all-speak", "some-silent"] = "some-silent"
    """Condition of the sets, and name of it in the report; --tables runs both."""
    cache: Path = Path("cache")
    """Where default sets are kept."""
    validation_scenes: int = 100
    """Size of the default validation set."""
    test_scenes: int = 200
    """Size of the default test set."""
    rounds: int = RefinementConfig().rounds
    """Most rounds of refinement, at least 1, for the rows refined."""
    same_band: bool = False
    """Let the baselines search all frequencies that the system listens to, instead of pyroomacoustics' 500-4000 Hz."""
    workers: int | None = None
    """Processes for the baselines; by default one per core."""
    device: str = "cpu"
    """Torch device of the networks."""


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError, OSError: told in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    evaluate_with(tyro.cli(EvaluateOptions, args=args))


def evaluate_with(options: EvaluateOptions) -> None:
    """Evaluates as the options say, prints the tables and writes the report."""
    if options.workers is not None and options.workers < 1:
        raise InputError(f"--workers is {options.workers}; give a number of at least 1, or none for one per core.")
    if options.sets is not None and (options.validation_data or options.test_data):
        raise InputError("--sets brings scenes for both; leave out --validation-data and --test-data.")
    if options.tables and (options.validation_data or options.test_data):
        raise InputError("--tables runs both conditions; give --sets instead of --validation-data and --test-data.")
    suites = _suites(options)
    if options.tables:
        run_paper(suites, partial(labeled_scenes, options), options.out).print()
        print(f"{options.out / 'tables.md'}: written, and tables.json and roc.png beside it.")
        return
    (suite,) = suites
    array = suite.system.config.array
    scenes_of = partial(labeled_scenes, options, options.condition, array=array)
    runs = run_methods(suite.methods(), scenes_of(VALIDATION), scenes_of(TEST))
    rows = score_runs(runs, options.condition, array.num_microphones)
    write_report(rows, options.out)
    print_report(rows)
    print(f"{options.out / 'report.json'}: written, and report.md beside it.")


def _systems(options: EvaluateOptions) -> list[System]:
    """The systems of the checkpoints, or those that come with the package."""
    if options.tables:
        if options.array is not None:
            raise InputError(
                "--tables shows every array; leave out --array, and give a --checkpoint of each array or none at all."
            )
        return (
            load_systems(options.checkpoint) if options.checkpoint else [load_weights_of(name) for name in PRETRAINED]
        )
    if len(options.checkpoint) > 1:
        raise InputError(f"{len(options.checkpoint)} checkpoints were given; give one, or add --tables.")
    system, _ = choose_system(next(iter(options.checkpoint), None), options.array, MOST_GENERAL)
    return [system]


def load_systems(checkpoints: Sequence[Path]) -> list[System]:
    """The systems of some checkpoints, by number of microphones.

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


def _suites(options: EvaluateOptions) -> list[MethodSuite]:
    systems = _systems(options)
    without_audio = load_systems(options.no_audio_checkpoint) if options.no_audio_checkpoint else []
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
            RefinementConfig(rounds=options.rounds),
            system_band_hz(system) if options.same_band else DEFAULT_BAND_HZ,
            options.workers,
            options.device,
        )
        for system in systems
    ]


def labeled_scenes(options: EvaluateOptions, condition: str, split: Split, array: MicrophoneArray) -> LabeledClips:
    """Scenes of the given folders, or the default ones of the condition and split."""
    folders = options.validation_data if split is VALIDATION else options.test_data
    if options.sets is not None:
        if not options.sets.is_dir():
            raise InputError(f"{options.sets}: no such folder; --sets wants one with '{condition}-{split.name}' in it.")
        folders = (options.sets / f"{condition}-{split.name}",)
    if folders:
        return LabeledClips(SceneDataset(folders, array))
    num_scenes = options.validation_scenes if split is VALIDATION else options.test_scenes
    return LabeledClips(default_dataset(options.cache, split, condition, num_scenes, array))

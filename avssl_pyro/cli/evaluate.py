"""Scores trained systems and audio-only baselines: ``avssl evaluate``."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from avssl_pyro.cli.options import DEFAULT_DEVICE, DEFAULT_WORKERS, Device, Workers, choose_system, parse_options
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.systems.config import MOST_GENERAL, PRETRAINED

if TYPE_CHECKING:
    from avssl_pyro.acoustics.array import MicrophoneArray
    from avssl_pyro.datasets.builtin import Split
    from avssl_pyro.datasets.dataset import LabeledClips
    from avssl_pyro.systems.system import System


@dataclass(frozen=True)
class EvaluateOptions:
    """Score a trained system and audio-only baselines on labelled scenes.

    The baselines are MUSIC, NormMUSIC and SRP-PHAT. The scores are precision, recall, F-measure, count accuracy and
    error. Thresholds of every method are tuned on the validation scenes and applied to the test scenes. With --tables,
    the paper's Tables I-III are made: both conditions, every array, the published numbers, tolerances and calibration.
    """

    checkpoint: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Checkpoint of 'avssl train' (.safetensors); with --tables repeat the option for each number of microphones. By
    default the pretrained weights."""
    array: str | None = None
    """Without --tables: preset or YAML file of the array; by default that of --checkpoint, or circle6."""
    out: Path = Path("runs/evaluation")
    """Folder for report.json and report.md, or tables.json, tables.md, roc.png and cells/."""
    tables: bool = False
    """Make the paper's tables. Finished cells are stored in --out, and the same command continues where it stopped."""
    no_audio_checkpoint: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Checkpoint of 'avssl train --guide.no-audio-net'; repeat the option for each array. By default the row
    no-audio-net is the same visual network with all mixing levels at 1/K."""
    sets: Path | None = None
    """Folder with four sets of 'avssl simulate': all-speak-validation, all-speak-test, some-silent-validation and
    some-silent-test; by default small sets rendered into --cache."""
    validation_data: tuple[Path, ...] = ()
    """Instead of --sets, without --tables: folders of shards to tune thresholds on."""
    test_data: tuple[Path, ...] = ()
    """Instead of --sets, without --tables: folders of shards to score."""
    condition: Literal["all-speak", "some-silent", "wide"] = "some-silent"
    """Condition of the sets, as named in the report; --tables runs both."""
    cache: Path = Path("cache")
    """Folder of the default sets."""
    num_validation_scenes: int = 100
    """Number of scenes in the default validation set."""
    num_test_scenes: int = 200
    """Number of scenes in the default test set."""
    rounds: int = RefinementConfig().rounds
    """Largest number of rounds of refinement, at least 1, for the refined rows."""
    same_band: bool = False
    """Use all frequencies of the system's spectrogram for the baselines, instead of pyroomacoustics' 500-4000 Hz."""
    workers: Workers = DEFAULT_WORKERS
    device: Device = DEFAULT_DEVICE


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError, OSError: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    evaluate_with(parse_options(EvaluateOptions, args))


def evaluate_with(options: EvaluateOptions) -> None:
    """Scores the systems and baselines, prints the tables and writes the report."""
    _check(options)
    from avssl_pyro.benchmarks.comparison import load_systems, make_suites, run_methods, score_runs
    from avssl_pyro.benchmarks.paper.experiment import run_paper
    from avssl_pyro.benchmarks.result_tables import print_report, write_report
    from avssl_pyro.datasets.builtin import TEST, VALIDATION

    suites = make_suites(
        _systems(options),
        load_systems(options.no_audio_checkpoint),
        RefinementConfig(rounds=options.rounds),
        options.same_band,
        options.workers,
        options.device,
    )
    if options.tables:
        run_paper(suites, partial(_scenes, options), options.out).print()
        print(f"{options.out / 'tables.md'}: written, and tables.json and roc.png beside it.")
        return
    (suite,) = suites
    array = suite.system.config.array
    scenes_of = partial(_scenes, options, options.condition, array=array)
    runs = run_methods(suite.methods(), scenes_of(VALIDATION), scenes_of(TEST))
    rows = score_runs(runs, options.condition, array.num_microphones)
    write_report(rows, options.out)
    print_report(rows)
    print(f"{options.out / 'report.json'}: written, and report.md beside it.")


def _check(options: EvaluateOptions) -> None:
    if options.sets is not None and (options.validation_data or options.test_data):
        raise InputError("--sets brings scenes for both; leave out --validation-data and --test-data.")
    if options.tables and (options.validation_data or options.test_data):
        raise InputError("--tables runs both conditions; give --sets instead of --validation-data and --test-data.")
    if options.tables and options.array is not None:
        raise InputError(
            "--tables shows every array; leave out --array, and give a --checkpoint of each array or none at all."
        )
    if not options.tables and len(options.checkpoint) > 1:
        raise InputError(f"{len(options.checkpoint)} checkpoints were given; give one, or add --tables.")


def _systems(options: EvaluateOptions) -> "list[System]":
    """Returns the systems of the checkpoints, or the pretrained systems."""
    from avssl_pyro.benchmarks.comparison import load_systems
    from avssl_pyro.systems.pretrained import load_weights_of

    if options.tables:
        return load_systems(options.checkpoint) or [load_weights_of(name) for name in PRETRAINED]
    system, _ = choose_system(next(iter(options.checkpoint), None), options.array, MOST_GENERAL)
    return [system]


def _scenes(options: EvaluateOptions, condition: str, split: "Split", array: "MicrophoneArray") -> "LabeledClips":
    """Opens the given folders, or the default scenes of the condition and split."""
    from avssl_pyro.datasets.builtin import VALIDATION, open_scenes

    folders = options.validation_data if split is VALIDATION else options.test_data
    num_scenes = options.num_validation_scenes if split is VALIDATION else options.num_test_scenes
    if options.sets is not None:
        if not options.sets.is_dir():
            raise InputError(f"{options.sets}: no such folder; give one that contains '{condition}-{split.name}'.")
        folders = (options.sets / f"{condition}-{split.name}",)
    return open_scenes(folders, array, options.cache, split, condition, num_scenes)

"""Scores a trained system beside audio-only baselines on labelled scenes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import tyro

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.data.clip import Clip, SceneLabels
from avssl_pyro.data.dataset import SceneDataset
from avssl_pyro.data.default_scenes import TEST, VALIDATION, Split, default_dataset
from avssl_pyro.evaluation.baselines import default_baselines
from avssl_pyro.evaluation.experiment import run_methods, score_runs
from avssl_pyro.evaluation.methods import Method
from avssl_pyro.evaluation.posterior_method import PosteriorMethod
from avssl_pyro.evaluation.report import print_table, write_report
from avssl_pyro.guides.refined import RefinementConfig
from avssl_pyro.inference.checkpoint import load_checkpoint
from avssl_pyro.inference.localizer import Localizer


@dataclass(frozen=True)
class EvaluateOptions:
    """Precision, recall, F-measure, count accuracy and error of a checkpoint, of MUSIC, NormMUSIC and SRP-PHAT.

    Thresholds of every method are tuned on the validation scenes and applied to the test scenes.
    """

    checkpoint: Path
    """Checkpoint of svi_train.py (.safetensors)."""
    out: Path = Path("runs/evaluation")
    """Folder for report.json and report.md."""
    no_audio_checkpoint: Path | None = None
    """A checkpoint trained with --guide.no-audio-net; by default the row no-audio-net is the same visual network with
    all mixing levels at 1/K."""
    validation: tuple[Path, ...] = ()
    """Folders of shards to tune thresholds on; by default a small set made here."""
    test: tuple[Path, ...] = ()
    """Folders of shards to score; by default a small set made here."""
    condition: Literal["all-speak", "some-silent"] = "some-silent"
    """Condition of the default sets, and name of it in the report."""
    cache: Path = Path("cache")
    """Where default sets are kept."""
    validation_scenes: int = 100
    """Size of the default validation set."""
    test_scenes: int = 200
    """Size of the default test set."""
    rounds: int = RefinementConfig.rounds
    """Most rounds of closed-form ascent per clip, for the row refined."""
    jobs: int = -1
    """Processes for the baselines; -1 is one per core."""
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
    system = load_checkpoint(options.checkpoint)
    without_audio = system if options.no_audio_checkpoint is None else load_checkpoint(options.no_audio_checkpoint)
    array, grid = system.config.array, system.config.grid
    amortized = Localizer(system, options.device)
    no_audio = Localizer(without_audio, options.device, uniform_levels=True)
    methods: list[Method[Any, Any]] = [
        *default_baselines(array, grid, options.jobs),
        PosteriorMethod("no-audio-net", no_audio.posteriors, grid),
        PosteriorMethod("amortized", amortized.posteriors, grid),
    ]
    if system.config.guide.audio_net:
        refined = Localizer(system, options.device, refinement=system.refinement(rounds=options.rounds))
        methods.append(PosteriorMethod("refined", refined.posteriors, grid))
    scenes = partial(labeled_scenes, options, array)
    runs = run_methods(
        methods,
        scenes(options.validation, VALIDATION, options.validation_scenes),
        scenes(options.test, TEST, options.test_scenes),
    )
    rows = score_runs(runs, options.condition, array.num_microphones)
    write_report(rows, options.out)
    print_table(rows)
    print(f"{options.out / 'report.json'}: written, and report.md beside it.")


class LabeledScenes(Sequence[tuple[Clip, SceneLabels]]):
    """A data set with its labels, read as it is walked through."""

    def __init__(self, dataset: SceneDataset) -> None:
        self._dataset = dataset

    def __len__(self) -> int:
        return len(self._dataset)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return self._dataset[index], self._dataset.labels(index)

    def __iter__(self) -> Iterator[tuple[Clip, SceneLabels]]:
        for index in range(len(self)):
            yield self._dataset[index], self._dataset.labels(index)


def labeled_scenes(
    options: EvaluateOptions, array: MicrophoneArray, folders: tuple[Path, ...], split: Split, num_scenes: int
) -> LabeledScenes:
    """Scenes of the given folders, or the default ones of the split."""
    if folders:
        return LabeledScenes(SceneDataset(folders, array))
    return LabeledScenes(default_dataset(options.cache, split, options.condition, num_scenes, array))

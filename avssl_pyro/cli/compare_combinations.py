"""Runs combinations of priors, likelihoods and guides on the same clips and puts them into one table."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.benchmarks.combinations import RECIPES, run_combinations
from avssl_pyro.cli.options import choose_system
from avssl_pyro.datasets.builtin import TEST, VALIDATION, Split, default_dataset
from avssl_pyro.datasets.dataset import LabeledClips, SceneDataset
from avssl_pyro.errors import InputError
from avssl_pyro.systems.config import MOST_GENERAL


@dataclass(frozen=True)
class CombinationOptions:
    """F-measure, count accuracy, ELBO and time of combinations of priors, likelihoods and guides.

    Each has its thresholds tuned on the validation clips. Finished rows are kept in --out: the same command goes on
    where it stopped.
    """

    checkpoint: Path | None = None
    """Checkpoint of svi_train.py; by default the weights that come with the package."""
    array: str | None = None
    """Preset or YAML file of the array; by default that of the checkpoint, or circle6."""
    validation_data: tuple[Path, ...] = ()
    """Folders of shards to tune thresholds on; by default scenes made here."""
    test_data: tuple[Path, ...] = ()
    """Folders of shards to score."""
    validation_scenes: int = 100
    """Most scenes to tune on."""
    test_scenes: int = 200
    """Most scenes to score."""
    first: int | None = None
    """Run the first so many combinations only."""
    cache: Path = Path("cache")
    """Where default sets are kept."""
    out: Path = Path("runs/combinations")
    """Folder for combinations.json, combinations.md and rows/."""
    seed: int = 0
    """Of the draws behind ELBOs and intervals."""


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError, OSError: told in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    options = tyro.cli(CombinationOptions, args=args)
    if min(options.validation_scenes, options.test_scenes) < 1:
        raise InputError(
            f"--validation-scenes {options.validation_scenes} and --test-scenes {options.test_scenes}: both must be at "
            "least 1."
        )
    if options.first is not None and options.first < 1:
        raise InputError(f"--first is {options.first}; give at least 1, or leave it out for all combinations.")
    system, array = choose_system(options.checkpoint, options.array, MOST_GENERAL)
    sets = (_scenes(options, VALIDATION, array), _scenes(options, TEST, array))
    sizes = (options.validation_scenes, options.test_scenes)
    recipes = RECIPES[: options.first]
    run_combinations(recipes, system, sets, sizes, options.out, options.seed).print()
    print(f"{options.out / 'combinations.md'}: written, and combinations.json beside it.")


def _scenes(options: CombinationOptions, split: Split, array: MicrophoneArray) -> LabeledClips:
    folders = options.validation_data if split is VALIDATION else options.test_data
    if folders:
        return LabeledClips(SceneDataset(folders, array))
    num_scenes = options.validation_scenes if split is VALIDATION else options.test_scenes
    return LabeledClips(default_dataset(options.cache, split, "some-silent", num_scenes, array))

"""Runs combinations of priors, likelihoods and guides on the same clips and puts them into one table."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import tyro
from rich import box
from rich.console import Console
from rich.table import Table

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.benchmarks.combinations import ELBO_DRAWS, PER_SCENE, RECIPES, CombinationRow, Recipe, run_recipe
from avssl_pyro.cli.options import choose_system
from avssl_pyro.datasets.builtin import TEST, VALIDATION, Split, default_dataset
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.labeled_scenes import LabeledScenes
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.systems.checkpoint import fingerprint
from avssl_pyro.systems.config import MOST_GENERAL

# Counted up when the same facts lead to other numbers.
FORMAT = 2
COLUMNS = ("combination", "F", "count", "ELBO", "ms/clip")


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
    sets = [_scenes(options, split, array) for split in (VALIDATION, TEST)]
    facts = {
        "format": FORMAT,
        "guides": [asdict(RefinementConfig()), asdict(PER_SCENE), ELBO_DRAWS],
        "system": fingerprint(system),
        "sets": [scenes.fingerprint for scenes in sets],
        "scenes": [options.validation_scenes, options.test_scenes],
        "seed": options.seed,
    }
    validation, test = sets[0][: options.validation_scenes], sets[1][: options.test_scenes]
    rows = []
    recipes = RECIPES[: options.first]
    for number, recipe in enumerate(recipes, start=1):
        print(f"{number} of {len(recipes)}: {', '.join(recipe.words)}.", flush=True)
        path = _row_path(options.out, recipe, facts)
        if not path.exists():
            row = run_recipe(recipe, system, validation, test, options.seed)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, json.dumps(asdict(row)).encode())
        rows.append(_read(path))
    write_atomically(options.out / "combinations.json", json.dumps([asdict(row) for row in rows], indent=1).encode())
    write_atomically(options.out / "combinations.md", markdown(rows).encode())
    _print(rows)
    print(f"{options.out / 'combinations.md'}: written, and combinations.json beside it.")


def _scenes(options: CombinationOptions, split: Split, array: MicrophoneArray) -> LabeledScenes:
    folders = options.validation_data if split is VALIDATION else options.test_data
    if folders:
        return LabeledScenes(SceneDataset(folders, array))
    num_scenes = options.validation_scenes if split is VALIDATION else options.test_scenes
    return LabeledScenes(default_dataset(options.cache, split, "some-silent", num_scenes, array))


def _row_path(out: Path, recipe: Recipe, facts: dict[str, object]) -> Path:
    """Where a row is kept; other weights, scenes or settings lead to another file."""
    digest = hashlib.sha256(json.dumps({**facts, "recipe": recipe.words}, sort_keys=True).encode()).hexdigest()
    return out / "rows" / f"{digest[:16]}.json"


def _read(path: Path) -> CombinationRow:
    try:
        return CombinationRow(**json.loads(path.read_text(encoding="utf-8")))
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged ({error}); delete it and run the same command again.") from error


def _cells(row: CombinationRow) -> tuple[str, ...]:
    return (
        row.name,
        f"{row.f_measure:.3f} ({row.f_low:.2f}-{row.f_high:.2f})",
        f"{row.count_accuracy:.3f} ({row.count_low:.2f}-{row.count_high:.2f})",
        f"{row.elbo:.4f}",
        f"{row.ms_per_clip:.0f}",
    )


def markdown(rows: Sequence[CombinationRow]) -> str:
    """The table as Markdown."""
    lines = [f"| {' | '.join(COLUMNS)} |", "|---|---:|---:|---:|---:|"]
    return "\n".join([*lines, *(f"| {' | '.join(_cells(row))} |" for row in rows), ""])


def _print(rows: Sequence[CombinationRow]) -> None:
    table = Table(box=box.SIMPLE_HEAD, caption=f"If not said: {', '.join(Recipe().words[1:])}.")
    for index, name in enumerate(COLUMNS):
        table.add_column(name, justify="right" if index else "left")
    for row in rows:
        table.add_row(*_cells(row))
    Console().print(table)

"""Pictures in the manner of the paper's Fig. 5, of scenes that a rule has chosen."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.data.dataset import SceneDataset
from avssl_pyro.errors import InputError
from avssl_pyro.inference.checkpoint import load_checkpoint
from avssl_pyro.inference.localization import SourceThresholds, select_sources
from avssl_pyro.inference.localizer import Localizer
from avssl_pyro.inference.pretrained import MOST_GENERAL, load_pretrained
from avssl_pyro.inference.system import System
from avssl_pyro.viz.overlay import save_overlay


@dataclass(frozen=True)
class GalleryOptions:
    """Draw the first scenes of a set in which somebody is silent: three with two talkers and three with three."""

    scenes: Path
    """Folder of shards made by simulate.py."""
    out: Path = Path("runs/gallery")
    """Folder for talkers2-0.png and so on."""
    checkpoint: Path | None = None
    """Checkpoint of svi_train.py; by default the weights that come with the package."""
    array: str = MOST_GENERAL
    """Without --checkpoint: preset or YAML file of the array."""
    each: int = 3
    """Pictures for each number of talkers."""


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError, OSError: told in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    options = tyro.cli(GalleryOptions, args=args)
    if options.checkpoint is None:
        system = load_pretrained(resolve_array(options.array)).system
    else:
        system = load_checkpoint(options.checkpoint)
    dataset = SceneDataset(options.scenes, system.config.array)
    for talkers in (2, 3):
        chosen = chosen_scenes(dataset, talkers, options.each)
        if not chosen:
            raise InputError(
                f"{options.scenes}: no scene has {talkers} talkers and a silent person; give other scenes."
            )
        for number, index in enumerate(chosen):
            draw(system, dataset, index, options.out / f"talkers{talkers}-{number}.png")
    print(f"{options.out}: written.")


def chosen_scenes(dataset: SceneDataset, talkers: int, most: int) -> list[int]:
    """Indices of the first scenes with so many talkers and at least one silent person."""
    chosen: list[int] = []
    for index in range(len(dataset)):
        labels = dataset.labels(index)
        if len(labels.talker_azimuths) == talkers and labels.silent_azimuths:
            chosen.append(index)
        if len(chosen) == most:
            break
    return chosen


def draw(system: System, dataset: SceneDataset, index: int, path: Path) -> None:
    """Draws what the refined posterior says of a scene, with its true azimuths."""
    localizer = Localizer(system, refinement=system.refinement())
    clip = dataset[index]
    (posterior,) = localizer.posteriors([clip])
    sources = select_sources(posterior, system.config.grid, SourceThresholds())
    truth = np.array(dataset.labels(index).talker_azimuths)
    save_overlay(path, clip.image_ijc, posterior, sources, system.config.grid, truth=truth)

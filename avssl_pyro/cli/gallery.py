"""Pictures in the manner of the paper's Fig. 5, of scenes that a rule has chosen."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import tyro

from avssl_pyro.cli.options import choose_system
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.io.png import save_png
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.localization.posterior import REFINED_THRESHOLDS, select_sources
from avssl_pyro.systems.config import MOST_GENERAL
from avssl_pyro.systems.system import System
from avssl_pyro.viz.overlay import draw_overlay

COLUMN_WIDTH, GAP = 800, 8
LEAST_DISTANCE_M = 1.0


@dataclass(frozen=True)
class GalleryOptions:
    """Draw the first scenes of a set in which somebody is silent: some with two talkers, as many with three.

    Scenes with anybody closer than a metre are passed over, so that no face is larger than a few pixels.
    """

    data: Path
    """Folder of shards made by simulate.py."""
    out: Path = Path("runs/gallery.png")
    """The picture: scenes with two talkers on the left, with three on the right."""
    checkpoint: Path | None = None
    """Checkpoint of svi_train.py; by default the weights that come with the package."""
    array: str | None = None
    """Preset or YAML file of the array; by default that of the checkpoint, or circle6."""
    each: int = 3
    """Scenes for each number of talkers."""


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError, OSError: told in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    options = tyro.cli(GalleryOptions, args=args)
    if options.out.suffix.lower() != ".png" or options.each < 1:
        raise InputError(f"--out {options.out} must end in .png, and --each {options.each} be at least 1.")
    system, _ = choose_system(options.checkpoint, options.array, MOST_GENERAL)
    dataset = SceneDataset(options.data, system.config.array)
    localizer = refining_localizer(system)
    columns = [_column(localizer, dataset, talkers, options) for talkers in (2, 3)]
    save_png(options.out, np.concatenate(columns, axis=1))
    print(f"{options.out}: written.")


def _column(
    localizer: Localizer, dataset: SceneDataset, talkers: int, options: GalleryOptions
) -> npt.NDArray[np.uint8]:
    chosen = chosen_scenes(dataset, talkers, options.each)
    if len(chosen) < options.each:
        raise InputError(
            f"{options.data}: only {len(chosen)} scenes have {talkers} talkers, a silent person and nobody close; "
            "give more scenes."
        )
    pictures = []
    for index in chosen:
        picture_ijc = overlay_of(localizer, dataset, index)
        height = round(picture_ijc.shape[0] * COLUMN_WIDTH / picture_ijc.shape[1])
        small_ijc = cv2.resize(picture_ijc, (COLUMN_WIDTH, height), interpolation=cv2.INTER_AREA)
        pictures.append(cv2.copyMakeBorder(small_ijc, 0, GAP, 0, GAP, cv2.BORDER_CONSTANT, value=(255, 255, 255)))
    return np.concatenate(pictures).astype(np.uint8)


def chosen_scenes(dataset: SceneDataset, talkers: int, most: int) -> list[int]:
    """Indices of the first scenes with so many talkers, at least one silent person, and nobody closer than a metre."""
    chosen: list[int] = []
    for index in range(len(dataset)):
        labels, people = dataset.labels(index), dataset.facts(index).get("people", ())
        apart = all(person["distance_m"] >= LEAST_DISTANCE_M for person in people)
        if len(labels.talker_azimuths) == talkers and labels.silent_azimuths and apart:
            chosen.append(index)
        if len(chosen) == most:
            break
    return chosen


def refining_localizer(system: System) -> Localizer:
    """What :func:`overlay_of` wants: one for all scenes."""
    return Localizer(system, refinement=RefinementConfig())


def overlay_of(localizer: Localizer, dataset: SceneDataset, index: int) -> npt.NDArray[np.uint8]:
    """What the posterior says of a labelled scene, with its true azimuths, RGB."""
    clip, grid = dataset[index], localizer.config.grid
    (posterior,) = localizer.posteriors([clip])
    sources = select_sources(posterior, grid, REFINED_THRESHOLDS)
    truth = np.array(dataset.labels(index).talker_azimuths)
    return draw_overlay(clip.image_ijc, posterior, sources, grid, truth=truth)

"""Pictures in the manner of the paper's Fig. 5, of scenes that a rule has chosen."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from avssl_pyro.benchmarks.gallery import draw_gallery
from avssl_pyro.cli.options import choose_system
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.io.images import save_png
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.systems.config import MOST_GENERAL


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
    localizer = Localizer(system, refinement=RefinementConfig())
    save_png(options.out, draw_gallery(localizer, SceneDataset(options.data, system.config.array), options.each))
    print(f"{options.out}: written.")

"""Draws overlays of scenes chosen by a rule, as in Fig. 5: ``avssl gallery``."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from avssl_pyro.cli.options import choose_system, parse_options
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.systems.config import MOST_GENERAL


@dataclass(frozen=True)
class GalleryOptions:
    """Draw the first scenes of a set with a silent person.

    As many have two talkers as three. Scenes with a person closer than a metre are left out, so that no face is larger
    than a few pixels.
    """

    data: Path
    """Folder of shards made by 'avssl simulate'."""
    out: Path = Path("runs/gallery.png")
    """PNG file: scenes with two talkers on the left, with three on the right."""
    checkpoint: Path | None = None
    """Checkpoint of 'avssl train'; by default the pretrained weights."""
    array: str | None = None
    """Preset or YAML file of the array; by default that of --checkpoint, or circle6."""
    num_each: int = 3
    """Number of scenes for each number of talkers."""


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError, OSError: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    options = parse_options(GalleryOptions, args)
    if options.out.suffix.lower() != ".png" or options.num_each < 1:
        raise InputError(f"--out {options.out} must end in .png, and --num-each {options.num_each} be at least 1.")
    from avssl_pyro.benchmarks.gallery import draw_gallery
    from avssl_pyro.datasets.dataset import SceneDataset
    from avssl_pyro.io.images import save_png
    from avssl_pyro.localization.localizer import Localizer

    system, _ = choose_system(options.checkpoint, options.array, MOST_GENERAL)
    localizer = Localizer(system, refinement=RefinementConfig())
    save_png(options.out, draw_gallery(localizer, SceneDataset(options.data, system.config.array), options.num_each))
    print(f"{options.out}: written.")

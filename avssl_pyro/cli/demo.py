"""Runs the whole method on simulated scenes, on two cores: ``avssl demo``."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from avssl_pyro.cli.options import parse_options
from avssl_pyro.training.config import PRESETS, OptimizationConfig

if TYPE_CHECKING:
    from avssl_pyro.datasets.dataset import SceneDataset
    from avssl_pyro.localization.localizer import Localizer

FIRST_ARRAY = "circle6"


@dataclass(frozen=True)
class DemoOptions:
    """Run the whole method: localize, simulate, train, evaluate and draw.

    The first scene is localized with the pretrained weights; training needs no labels.
    """

    out: Path = Path("runs/demo")
    """Folder of the results."""
    cache: Path = Path("cache")
    """Folder of the simulated scenes."""
    num_scenes: int = 3000
    """Number of training scenes."""
    num_test_scenes: int = 200
    """Number of test scenes."""
    num_validation_scenes: int = 100
    """Number of validation scenes, on which thresholds are tuned."""
    num_overlays: int = 6
    """Number of overlays to draw, one for each of the first test scenes."""
    optimization: OptimizationConfig = PRESETS["quick"].optimization


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process)."""
    options = parse_options(DemoOptions, args)
    picture = draw_first_picture(options.out / "first")
    print(f"{picture}: a scene, localized with the pretrained weights; its separated sounds are beside it.", flush=True)
    _train_and_compare(options)
    print(f"{options.out}: holds report.md, curves.png and overlay-*.png.")


def draw_first_picture(folder: Path) -> Path:
    """Localizes one simulated scene; writes its overlay and its separated sounds.

    Args:
        folder: folder of the files; it is made if it does not exist.

    Returns:
        The path of the overlay.
    """
    from avssl_pyro.api.model import load
    from avssl_pyro.api.simulation import simulate

    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as scenes:
        clip = simulate(scenes, 1, array=FIRST_ARRAY, workers=1)[0]
    result = load(FIRST_ARRAY).localize(clip.audio_mn, clip.image_ijc)
    picture = folder / "overlay.png"
    result.plot(picture)
    result.save_sounds(folder, "source")
    return picture


def _train_and_compare(options: DemoOptions) -> None:
    from avssl_pyro.cli.evaluate import EvaluateOptions, evaluate_with
    from avssl_pyro.datasets.builtin import TEST, default_dataset
    from avssl_pyro.guides.refinement_config import RefinementConfig
    from avssl_pyro.localization.localizer import Localizer
    from avssl_pyro.systems.checkpoint import load_checkpoint
    from avssl_pyro.training.run import run_training
    from avssl_pyro.training.svi import CHECKPOINT_NAME
    from avssl_pyro.viz.plots import save_run_curves

    checkpoint = options.out / CHECKPOINT_NAME
    run_training(
        replace(
            PRESETS["quick"],
            out=options.out,
            cache=options.cache,
            num_scenes=options.num_scenes,
            optimization=options.optimization,
        ),
        on_end=save_run_curves,
    )
    evaluate_with(
        EvaluateOptions(
            (checkpoint,),
            out=options.out,
            cache=options.cache,
            num_validation_scenes=options.num_validation_scenes,
            num_test_scenes=options.num_test_scenes,
        )
    )
    system = load_checkpoint(checkpoint)
    test = default_dataset(options.cache, TEST, "some-silent", options.num_test_scenes, system.config.array)
    draw_overlays(Localizer(system, refinement=RefinementConfig()), test, options.num_overlays, options.out)


def draw_overlays(localizer: "Localizer", dataset: "SceneDataset", number: int, folder: Path) -> None:
    """Draws overlays of the first scenes of a data set as ``overlay-*.png``.

    Args:
        localizer: localizer of the scenes.
        dataset: scenes with their true azimuths.
        number: largest number of overlays.
        folder: folder of the pictures.
    """
    from avssl_pyro.benchmarks.gallery import draw_scene
    from avssl_pyro.io.images import save_png

    for index in range(min(number, len(dataset))):
        save_png(folder / f"overlay-{index}.png", draw_scene(localizer, dataset, index))

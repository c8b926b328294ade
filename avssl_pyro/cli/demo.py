"""The whole method on two cores: scenes, training without labels, evaluation, pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from avssl_pyro.cli.evaluate import EvaluateOptions, evaluate_with
from avssl_pyro.cli.options import parse_options
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.training.config import PRESETS, OptimizationConfig

if TYPE_CHECKING:
    from avssl_pyro.datasets.dataset import SceneDataset
    from avssl_pyro.localization.localizer import Localizer


@dataclass(frozen=True)
class DemoOptions:
    """Make scenes, train on them without labels, evaluate beside MUSIC and SRP-PHAT, and draw what was found."""

    out: Path = Path("runs/demo")
    """Folder for everything that comes out."""
    cache: Path = Path("cache")
    """Where scenes are kept."""
    scenes: int = 3000
    """Training scenes."""
    test_scenes: int = 200
    """Test scenes."""
    validation_scenes: int = 100
    """Scenes to tune thresholds on."""
    overlays: int = 6
    """Pictures to draw, of the first test scenes."""
    optimization: OptimizationConfig = PRESETS["quick"].optimization


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process)."""
    from avssl_pyro.datasets.builtin import TEST, default_dataset
    from avssl_pyro.localization.localizer import Localizer
    from avssl_pyro.systems.checkpoint import load_checkpoint
    from avssl_pyro.training.run import run_training
    from avssl_pyro.training.svi import CHECKPOINT_NAME
    from avssl_pyro.viz.plots import save_run_curves

    options = parse_options(DemoOptions, args)
    checkpoint = options.out / CHECKPOINT_NAME
    run_training(
        replace(
            PRESETS["quick"],
            out=options.out,
            cache=options.cache,
            scenes=options.scenes,
            optimization=options.optimization,
        ),
        on_end=save_run_curves,
    )
    evaluate_with(
        EvaluateOptions(
            (checkpoint,),
            out=options.out,
            cache=options.cache,
            num_validation_scenes=options.validation_scenes,
            num_test_scenes=options.test_scenes,
        )
    )
    system = load_checkpoint(checkpoint)
    test = default_dataset(options.cache, TEST, "some-silent", options.test_scenes, system.config.array)
    draw_overlays(Localizer(system, refinement=RefinementConfig()), test, options.overlays, options.out)
    print(f"{options.out}: report.md, curves.png and overlay-*.png are worth a look.")


def draw_overlays(localizer: Localizer, dataset: SceneDataset, number: int, folder: Path) -> None:
    """Draws the first ``number`` scenes of a data set with their true azimuths as ``overlay-*.png``."""
    from avssl_pyro.benchmarks.gallery import draw_scene
    from avssl_pyro.io.images import save_png

    for index in range(min(number, len(dataset))):
        save_png(folder / f"overlay-{index}.png", draw_scene(localizer, dataset, index))

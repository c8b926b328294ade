"""Measures how often the doctor finds yaw and mirror of a camera, on simulated recordings."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from avssl_pyro.benchmarks.camera import CameraExperiment, camera_table
from avssl_pyro.cli.options import AssetOptions, choose_system
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.motion import MovingPeopleConfig
from avssl_pyro.simulation.recordings import Camera
from avssl_pyro.systems.checkpoint import fingerprint


@dataclass(frozen=True)
class CameraBenchmarkOptions:
    """Estimate the yaw and mirror of cameras of simulated recordings, turned and mirrored at random.

    Every result is stored in --out: the same command continues where it stopped.
    """

    recordings: int = 20
    """Number of recordings."""
    seconds: float = 60.0
    """Length of each."""
    array: str = "circle6"
    """Array that hears them: a preset or a YAML file."""
    checkpoint: Path | None = None
    """Checkpoint of svi_train.py for this array; by default the weights that come with the package."""
    material: Annotated[AssetOptions, tyro.conf.arg(name="")] = field(default_factory=AssetOptions)
    standing_share: float = MovingPeopleConfig.standing_share
    """Of the people, by chance, who never walk. Two talkers who both stand for the whole recording look the same in a
    picture that is mirrored and turned so that they change places: no search can tell."""
    width: int = 576
    """Columns of the pictures, which are half as high."""
    seed: int = 0
    """Of the recordings."""
    out: Path = Path("runs/camera")
    """Folder that stores the result of every recording."""


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError, OSError: told in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    options = tyro.cli(CameraBenchmarkOptions, args=args)
    if not 0 <= options.standing_share <= 1:
        raise InputError(f"--standing-share is {options.standing_share:g}; give a share from 0 to 1.")
    if options.recordings < 1 or options.seconds < 8 or options.seed < 0 or options.width < 288:
        raise InputError(
            f"--recordings {options.recordings} --seconds {options.seconds:g} --width {options.width} --seed "
            f"{options.seed}: give at least 1 recording, 8 s, 288 columns and the seed 0."
        )
    system, array = choose_system(options.checkpoint, options.array)
    config = MovingPeopleConfig(standing_share=options.standing_share)
    camera = Camera(options.width)
    simulator = options.material.recording_simulator(config, options.seconds, options.seed, array, camera)
    settings = {
        "system": fingerprint(system),
        "material": str(options.material),
        **{name: getattr(options, name) for name in ("seconds", "array", "standing_share", "width", "seed")},
    }
    trials = CameraExperiment(simulator, system).run_all(options.recordings, options.out, settings)
    camera_table(trials, options.array, options.seconds).print()

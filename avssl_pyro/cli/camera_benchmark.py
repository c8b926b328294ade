"""Measures how often the doctor finds yaw and mirror of a camera, on simulated recordings."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from rich import box
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.benchmarks.camera import CameraExperiment, CameraTrial
from avssl_pyro.cli.options import AssetOptions, choose_system
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.camera import Camera
from avssl_pyro.simulation.moving_people import MovingPeopleConfig


@dataclass(frozen=True)
class CameraBenchmarkOptions:
    """Turn and mirror the cameras of simulated recordings at random, and see whether the doctor's search finds out.

    With --out every result is kept, and the same command goes on where it was stopped.
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
    out: Path | None = None
    """JSON lines to keep the results in."""


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
    experiment = _experiment(options)
    trials = _kept(options)
    for index in tqdm(range(options.recordings), unit="recording", desc="turning cameras"):
        if any(trial.index == index for trial in trials):
            continue
        trials.append(experiment.run(index))
        if options.out is not None:
            write_atomically(options.out, "".join(_line(options, trial) for trial in trials).encode())
    chosen = sorted((trial for trial in trials if trial.index < options.recordings), key=lambda trial: trial.index)
    Console().print(_table(chosen, options))


def _experiment(options: CameraBenchmarkOptions) -> CameraExperiment:
    system, array = choose_system(options.checkpoint, options.array)
    config = MovingPeopleConfig(standing_share=options.standing_share)
    simulator = options.material.recording_simulator(
        config, options.seconds, options.seed, array, Camera(options.width)
    )
    return CameraExperiment(simulator, system)


def _settings(options: CameraBenchmarkOptions) -> dict[str, str]:
    """What results depend on."""
    names = ("seconds", "array", "checkpoint", "material", "standing_share", "width", "seed")
    return {name: str(getattr(options, name)) for name in names}


def _line(options: CameraBenchmarkOptions, trial: CameraTrial) -> str:
    return json.dumps({"settings": _settings(options), **trial.to_dict()}) + "\n"


def _kept(options: CameraBenchmarkOptions) -> list[CameraTrial]:
    if options.out is None or not options.out.exists():
        return []
    try:
        rows = [json.loads(line) for line in options.out.read_text(encoding="utf-8").splitlines()]
        kept = [(row.pop("settings"), CameraTrial(**row)) for row in rows]
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(f"{options.out}: holds something else than results of this command ({error}).") from error
    if any(settings != _settings(options) for settings, _ in kept):
        raise InputError(f"{options.out}: holds results of other settings; give another --out, or delete it.")
    return [trial for _, trial in kept]


def _table(trials: Sequence[CameraTrial], options: CameraBenchmarkOptions) -> Table:
    right = sum(trial.right for trial in trials)
    table = Table(
        title=f"{options.array}: found in {right} of {len(trials)} recordings of {options.seconds:g} s",
        box=box.SIMPLE_HEAD,
    )
    for column in ("recording", "yaw", "mirrored", "found yaw", "found mirrored", "off", "sure", "right"):
        table.add_column(column, justify="right")
    for trial in trials:
        table.add_row(
            str(trial.index),
            f"{trial.yaw_deg:.1f}°",
            "yes" if trial.mirror else "no",
            f"{trial.found_yaw_deg:.1f}°",
            "yes" if trial.found_mirror else "no",
            f"{trial.error_deg:.1f}°",
            f"{trial.confidence:.0%}",
            "yes" if trial.right else "cannot tell" if not trial.told else "no",
        )
    return table

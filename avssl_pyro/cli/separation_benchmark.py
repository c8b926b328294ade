"""Measures how well talkers are separated, on simulated mixtures whose parts are known."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from tqdm import tqdm

from avssl_pyro.benchmarks.separation import SeparationExperiment, separation_table
from avssl_pyro.benchmarks.separation_methods import BASELINE, OURS, default_methods
from avssl_pyro.cli.options import AssetOptions, choose_system
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.layout import SOME_SILENT, Condition, SceneConfig
from avssl_pyro.simulation.scenes import SceneSimulator


@dataclass(frozen=True)
class SeparationBenchmarkOptions:
    """Separate two talkers, among whom up to two silent people stand, and compare with who knows where they are.

    Scores are improvements of SI-SDR over the first microphone, in dB: against each talker's reverberant image at that
    microphone, and against the direct sound alone. A talker of whom no source was found within 10 degrees counts as 0.
    Rows: delay and sum towards the true mouths; the package's refined posterior with its filters, also with the
    posterior's own masks, unfitted; that of one forward pass; and ideal ratio masks from the talkers' own power.
    """

    scenes: int = 50
    """Number of mixtures."""
    array: str = "circle6"
    """Array that hears them: a preset or a YAML file."""
    checkpoint: Path | None = None
    """Checkpoint of svi_train.py for this array; by default the weights that come with the package."""
    material: Annotated[AssetOptions, tyro.conf.arg(name="")] = field(default_factory=AssetOptions)
    seed: int = 0
    """Of the scenes."""


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError, OSError: told in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    options = tyro.cli(SeparationBenchmarkOptions, args=args)
    if options.scenes < 1:
        raise InputError(f"--scenes is {options.scenes}; give a number of at least 1.")
    system, array = choose_system(options.checkpoint, options.array)
    simulator = SceneSimulator(
        config=SceneConfig(condition=Condition(SOME_SILENT.name, SOME_SILENT.people, talkers=(2,))),
        seed=options.seed,
        speech=options.material.speech_source(),
        people=options.material.person_source(),
        panoramas=options.material.panorama_source(),
        array=array,
    )
    experiment = SeparationExperiment(simulator, default_methods(system, array))
    trials = [experiment.run(index) for index in tqdm(range(options.scenes), unit="scene", desc="separating")]
    title = f"{options.array}: SI-SDR improvement in dB, {options.scenes} mixtures of two talkers, seed {options.seed}"
    separation_table(trials, title, OURS, BASELINE).print()

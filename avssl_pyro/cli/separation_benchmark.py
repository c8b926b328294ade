"""Measures how well talkers are separated, on simulated mixtures whose parts are known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.benchmarks.separation import SeparationExperiment
from avssl_pyro.benchmarks.separation_methods import (
    DelayAndSumAtTruth,
    OracleMasks,
    PosteriorSeparation,
    SeparationMethod,
)
from avssl_pyro.benchmarks.separation_table import separation_table
from avssl_pyro.cli.options import AssetOptions, choose_system
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.report import print_tables
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.localization.posterior import ONE_PASS_THRESHOLDS, REFINED_THRESHOLDS
from avssl_pyro.separation.beamforming import Masking, Mvdr
from avssl_pyro.separation.separator import SeparationConfig, Separator
from avssl_pyro.simulation.layout import SOME_SILENT, Condition, SceneConfig
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.systems.system import System

OURS = "refined: Wiener"
BASELINE = "delay and sum at the truth"


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
    experiment = SeparationExperiment(simulator, _methods(system, array))
    trials = [experiment.run(index) for index in tqdm(range(options.scenes), unit="scene", desc="separating")]
    title = f"{options.array}: SI-SDR improvement in dB, {options.scenes} mixtures of two talkers, seed {options.seed}"
    print_tables([separation_table(trials, title, OURS, BASELINE)])


def _methods(system: System, array: MicrophoneArray) -> list[SeparationMethod]:
    plain = SeparationConfig()
    unfitted = SeparationConfig(rounds=0, reverberation=0.0)
    refined = {
        OURS: plain,
        "refined: MVDR": replace(plain, extraction=Mvdr()),
        "refined: masks alone": replace(plain, extraction=Masking()),
        "unfitted: Wiener": unfitted,
        "unfitted: MVDR": replace(unfitted, extraction=Mvdr()),
        "unfitted: masks alone": replace(unfitted, extraction=Masking()),
    }
    one_pass = {"one pass: Wiener": plain, "one pass: MVDR": replace(plain, extraction=Mvdr())}

    def separators(configs: Mapping[str, SeparationConfig]) -> dict[str, Separator]:
        return {name: Separator(system.config, config) for name, config in configs.items()}

    return [
        DelayAndSumAtTruth(array, BASELINE),
        PosteriorSeparation(Localizer(system, refinement=RefinementConfig()), REFINED_THRESHOLDS, separators(refined)),
        PosteriorSeparation(Localizer(system), ONE_PASS_THRESHOLDS, separators(one_pass)),
        OracleMasks({"oracle masks: Wiener": plain.extraction, "oracle masks: MVDR": Mvdr()}),
    ]

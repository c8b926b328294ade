"""Measures how well talkers are separated, on simulated mixtures whose parts are known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from rich import box
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.cli.chosen_system import choose_system
from avssl_pyro.cli.material import MaterialOptions
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.metrics import Interval
from avssl_pyro.evaluation.separation_experiment import (
    UNPROCESSED,
    Improvements,
    SeparationExperiment,
    SeparationSummary,
    lead,
    summarize_separation,
)
from avssl_pyro.evaluation.separation_methods import (
    DelayAndSumAtTruth,
    OracleMasks,
    PosteriorSeparation,
    SeparationMethod,
)
from avssl_pyro.guides.refined import RefinementConfig
from avssl_pyro.inference.beamforming import Masking, Mvdr
from avssl_pyro.inference.localization import ONE_PASS_THRESHOLDS, REFINED_THRESHOLDS
from avssl_pyro.inference.localizer import Localizer
from avssl_pyro.inference.separation import SeparationConfig, Separator
from avssl_pyro.inference.system import System
from avssl_pyro.simulation.layout import SOME_SILENT, Condition, SceneConfig
from avssl_pyro.simulation.scenes import SceneSimulator

OURS = "refined, Wiener filter"
BASELINE = "delay and sum, true directions"


@dataclass(frozen=True)
class SeparationBenchmarkOptions:
    """Separate two talkers, among whom up to two silent people stand, and compare with who knows where they are.

    Scores are improvements of SI-SDR over the first microphone, in dB: against each talker's reverberant image at that
    microphone, and against the direct sound alone. A talker of whom no source was found within 10 degrees counts as 0.
    """

    scenes: int = 50
    """Number of mixtures."""
    array: str = "circle6"
    """Array that hears them: a preset or a YAML file."""
    checkpoint: Path | None = None
    """Checkpoint of svi_train.py for this array; by default the weights that come with the package."""
    material: Annotated[MaterialOptions, tyro.conf.arg(name="")] = field(default_factory=MaterialOptions)
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
    _print(trials, options)


def _methods(system: System, array: MicrophoneArray) -> list[SeparationMethod]:
    def separator(**changes: object) -> Separator:
        return Separator(system.config, SeparationConfig(**changes))  # type: ignore[arg-type]

    unfitted = {"rounds": 0, "reverberation": 0.0}
    refined = {
        OURS: separator(),
        "refined, MVDR": separator(extraction=Mvdr()),
        "refined, masks alone": separator(extraction=Masking()),
        "refined, masks not fitted, Wiener filter": separator(**unfitted),
        "refined, masks not fitted, MVDR": separator(extraction=Mvdr(), **unfitted),
        "refined, masks not fitted, alone": separator(extraction=Masking(), **unfitted),
    }
    one_pass = {"one pass, Wiener filter": separator(), "one pass, MVDR": separator(extraction=Mvdr())}
    oracle = {"oracle masks, Wiener filter": SeparationConfig().extraction, "oracle masks, MVDR": Mvdr()}
    return [
        DelayAndSumAtTruth(array),
        PosteriorSeparation(Localizer(system, refinement=RefinementConfig()), REFINED_THRESHOLDS, refined),
        PosteriorSeparation(Localizer(system), ONE_PASS_THRESHOLDS, one_pass),
        OracleMasks(oracle),
    ]


def _print(trials: Sequence[Mapping[str, Improvements]], options: SeparationBenchmarkOptions) -> None:
    console = Console()
    rows = summarize_separation(trials)
    before = rows.pop(UNPROCESSED)
    console.print(_table(rows, options))
    console.print(
        f"One microphone has an SI-SDR of {before.image_mean:.1f} dB against the image, {before.direct_mean:.1f} dB "
        "against the direct sound."
    )
    mean, interval = lead(trials, OURS, BASELINE)
    console.print(f"{OURS}: {mean:.1f} dB {_bounds(interval)} above {BASELINE}, against the image.")


def _table(rows: Mapping[str, SeparationSummary], options: SeparationBenchmarkOptions) -> Table:
    table = Table(
        title=f"{options.array}: SI-SDR improvement, dB, {options.scenes} mixtures of two talkers, seed {options.seed}",
        box=box.SIMPLE_HEAD,
        title_justify="left",
    )
    table.add_column("separated by", no_wrap=True)
    for column in ("image", "95 %", "median", "direct", "95 %", "median", "missed"):
        table.add_column(column, justify="right", no_wrap=True)
    for name, row in rows.items():
        table.add_row(
            name,
            f"{row.image_mean:.2f}",
            _bounds(row.image_interval),
            f"{row.image_median:.2f}",
            f"{row.direct_mean:.2f}",
            _bounds(row.direct_interval),
            f"{row.direct_median:.2f}",
            f"{row.missed:.1%}",
        )
    return table


def _bounds(interval: Interval) -> str:
    return f"{interval.low:.1f} to {interval.high:.1f}"

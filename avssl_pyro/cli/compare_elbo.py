"""Prints Pyro's ELBO beside the closed forms of the paper, for a checkpoint or a fresh model."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
import tyro
from rich import box
from rich.console import Console
from rich.table import Table

from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.acoustics.stft import stft
from avssl_pyro.batch import collate_clips
from avssl_pyro.cli.options import choose_system
from avssl_pyro.criticism.elbo_comparison import (
    Difference,
    explicit_mask_differences,
    mean_field_differences,
    sampled_agreement,
)
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.systems.config import GuideConfig, ModelConfig
from avssl_pyro.systems.system import System, SystemConfig, build_system

MAX_STANDARD_ERRORS = 4.0
MAX_RELATIVE = 1e-9
EXIT_DISAGREES = 1
FRESH_ARRAY = "circle4"


@dataclass(frozen=True)
class CompareOptions:
    """Compare Pyro's ELBO with Eqs. (15)-(19) and with enumerated masks, in double precision on simulated clips.

    Exit code 1 if exact quantities differ by more than 1e-9 or sampled ones by more than 4 standard errors.
    """

    checkpoint: Path | None = None
    """Checkpoint of svi_train.py; by default a fresh model."""
    array: str | None = None
    """Preset or YAML file of the array; by default that of the checkpoint, or circle4."""
    model: ModelConfig = field(default_factory=ModelConfig)
    guide: GuideConfig = field(default_factory=GuideConfig)
    clips: int = 2
    """Clips in the batch."""
    seconds: float = 0.25
    """Length of the clips; enumerated masks need memory."""
    draws: int = 50
    """Samples behind the comparison with Trace_ELBO."""
    seed: int = 0


def main(args: Sequence[str] | None = None) -> int:
    """Runs the command with ``args`` (by default those of the process) and returns its exit code."""
    options = tyro.cli(CompareOptions, args=args)
    if not 0 < options.seconds <= 1 or options.clips < 1:
        raise InputError(f"--seconds {options.seconds} and --clips {options.clips} must be in (0, 1] and at least 1.")
    system = double_precision(_system(options))
    x_bfmt, image_bcij = _batch(options, system)
    mean_field = mean_field_differences(system, x_bfmt, image_bcij, options.seed)
    explicit = explicit_mask_differences(system, x_bfmt, image_bcij, options.seed)
    sampled = sampled_agreement(system, x_bfmt, image_bcij, options.draws, options.seed)
    console = Console()
    console.print(_table("TraceMeanField_ELBO at one seed", "closed form", mean_field))
    console.print(_table("Marginal model at one seed", "enumerated masks", explicit))
    table = Table(title=f"Trace_ELBO, mean of {options.draws} draws", box=box.SIMPLE_HEAD, title_justify="left")
    for name in ("quantity", "closed form", "Pyro", "standard error", "z"):
        table.add_column(name, justify="left" if name == "quantity" else "right")
    cells = (
        f"{sampled.reference:.4f}",
        f"{sampled.mean:.4f}",
        f"{sampled.standard_error:.4f}",
        f"{sampled.z_score:+.2f}",
    )
    table.add_row("loss", *cells)
    console.print(table)
    agrees = max(row.relative for row in mean_field + explicit) <= MAX_RELATIVE
    agrees = agrees and abs(sampled.z_score) <= MAX_STANDARD_ERRORS
    console.print("agree." if agrees else "DISAGREE.", style="bold green" if agrees else "bold red")
    return 0 if agrees else EXIT_DISAGREES


def double_precision(system: System) -> System:
    """A copy of a system in float64 and evaluation mode, where two ways of computing can agree to rounding."""
    double = build_system(system.config, torch.float64)
    double.load_state_dict(system.state_dict())
    double.model.eval()
    double.guide.eval()
    return double


def _system(options: CompareOptions) -> System:
    if options.checkpoint is not None:
        system, _ = choose_system(options.checkpoint, options.array)
        if not system.config.guide.audio_net:
            raise InputError(
                f"{options.checkpoint}: has no audio network; the closed forms are those of the whole guide."
            )
        return system
    torch.manual_seed(options.seed)
    return build_system(SystemConfig(resolve_array(options.array or FRESH_ARRAY), options.model, options.guide))


def _batch(options: CompareOptions, system: System) -> tuple[torch.Tensor, torch.Tensor]:
    simulator = SceneSimulator(seed=options.seed, array=system.config.array)
    batch = collate_clips([simulator.render(index).clip for index in range(options.clips)])
    samples = round(options.seconds * system.config.stft.sample_rate)
    x_bfmt = stft(batch.audio_bmn[..., :samples].double(), system.config.stft)
    return x_bfmt, batch.image_float().double()


def _table(title: str, reference: str, rows: Sequence[Difference]) -> Table:
    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left")
    for name in ("quantity", reference, "Pyro", "relative difference"):
        table.add_column(name, justify="left" if name == "quantity" else "right")
    for row in rows:
        table.add_row(row.name, f"{row.reference:.10g}", f"{row.value:.10g}", f"{row.relative:.1e}")
    return table

"""Prints Pyro's ELBO beside the closed forms of the paper, for a checkpoint or a fresh model."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
import tyro

from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.benchmarks.elbo import compare_elbos
from avssl_pyro.cli.options import choose_system
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.tables import print_tables
from avssl_pyro.systems.config import GuideConfig, ModelConfig
from avssl_pyro.systems.system import System, SystemConfig, build_system

EXIT_DISAGREES = 1
FRESH_ARRAY = "circle4"


@dataclass(frozen=True)
class CompareOptions:
    """Compare Pyro's ELBO with Eqs. (13)-(16) and with enumerated masks, in double precision on simulated clips.

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
    agreement = compare_elbos(_system(options), options.clips, options.seconds, options.draws, options.seed)
    print_tables(agreement.tables())
    print("agree." if agreement.agrees else "DISAGREE.")
    return 0 if agreement.agrees else EXIT_DISAGREES


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

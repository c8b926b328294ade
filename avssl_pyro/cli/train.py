"""Trains the networks by stochastic variational inference."""

import sys
from collections.abc import Sequence

import tyro

from avssl_pyro.cli.first_look import given
from avssl_pyro.training.config import PRESETS, TrainingConfig
from avssl_pyro.training.divergence import TrainingDivergedError
from avssl_pyro.training.run import run_training
from avssl_pyro.viz.curves import save_run_curves

EXIT_DIVERGED = 1


def parse(args: Sequence[str] | None = None) -> TrainingConfig:
    """Options of the command line, on top of those of ``--preset``."""
    default = PRESETS.get(given("--preset", args) or "quick", PRESETS["quick"])
    return tyro.cli(TrainingConfig, default=default, args=args)


def main(args: Sequence[str] | None = None) -> int:
    """Runs the command with ``args`` (by default those of the process) and returns its exit code.

    Raises:
        InputError, OSError, KeyboardInterrupt: told in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    try:
        checkpoint = run_training(parse(args), on_end=save_run_curves)
    except TrainingDivergedError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_DIVERGED
    if checkpoint is not None:
        print(f"{checkpoint}: written.")
    return 0

"""Trains the networks by stochastic variational inference: ``avssl train``."""

import sys
from collections.abc import Sequence

from avssl_pyro.cli.options import given, parse_options
from avssl_pyro.training.config import PRESETS, TrainingConfig

EXIT_DIVERGED = 1


def parse(args: Sequence[str] | None = None) -> TrainingConfig:
    """Returns the options of the command line; ``--preset`` sets their defaults."""
    default = PRESETS.get(given("--preset", args) or "quick", PRESETS["quick"])
    return parse_options(TrainingConfig, args, default)


def main(args: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit code.

    Args:
        args: words of the command line; by default those of the process.

    Raises:
        InputError, OSError, KeyboardInterrupt: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    options = parse(args)
    from avssl_pyro.training.divergence import TrainingDivergedError
    from avssl_pyro.training.run import run_training
    from avssl_pyro.viz.plots import save_run_curves

    try:
        checkpoint = run_training(options, on_end=save_run_curves)
    except TrainingDivergedError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_DIVERGED
    if checkpoint is not None:
        print(f"{checkpoint}: written.")
    return 0

"""Simulation-based calibration: are the posteriors on offer as wide as the posterior is?"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from avssl_pyro.benchmarks.calibration import POSTERIORS, ToyModel, run_calibration
from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class CalibrateOptions:
    """Draw scenes from a small model, fit posteriors to them, and test whether the truth ranks uniformly among draws.

    Writes ranks.json and ranks.png. Finished batches are kept in the folder; a stopped command goes on where it was.
    """

    out: Path
    """Folder of the results."""
    posteriors: tuple[str, ...] = ("refined", "mean field")
    """Any of: 'refined', 'mean field', 'low rank', 'NUTS'; the last two are slow."""
    trials: int = 60
    """Scenes to draw; 200 tell more."""
    batch: int = 20
    """Scenes that are kept together, and sampled together by NUTS."""
    seed: int = 0
    """Of the first scene; the others count up."""


def main(args: Sequence[str] | None = None) -> int:
    """Runs the command with ``args`` (by default those of the process) and returns its exit code."""
    options = tyro.cli(CalibrateOptions, args=args)
    if options.trials < 1 or options.batch < 1:
        raise InputError(f"--trials {options.trials} and --batch {options.batch} must be at least 1.")
    if not options.posteriors:
        raise InputError("--posteriors: name at least one.")
    model = ToyModel()
    if unknown := [name for name in options.posteriors if name not in POSTERIORS]:
        raise InputError(f"--posteriors: there is no '{unknown[0]}'; choose from {', '.join(POSTERIORS)}.")
    report = run_calibration(model, options.posteriors, options.trials, options.batch, options.out, options.seed)
    report.write(options.out)
    report.table().print()
    print(f"{options.out / 'ranks.json'}: written, and ranks.png beside it.")
    return 0

"""Scores the directions found in a whole recording against its labels."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.benchmarks.recording_scores import compare_with_labels
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.tables import print_tables


@dataclass(frozen=True)
class ScoreOptions:
    """Score directions against labels in every frame of 100 ms, whatever their class."""

    labels: Path
    """CSV of the labels, in any of DCASE's forms."""
    estimates: tuple[Path, ...]
    """CSV files that localize.py --dcase wrote."""
    audio: Path | None = None
    """The recording, to put SRP-PHAT, MUSIC and NormMUSIC beside them."""
    array: str = "starss23-mic"
    """Array of --audio: a preset or a YAML file."""
    tolerances: tuple[float, ...] = (10.0, 20.0)
    """Largest errors that count as correct, degrees; a table for each."""


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError: a file cannot be read, or a tolerance is no angle.
    """
    options = tyro.cli(ScoreOptions, args=args)
    for tolerance_deg in options.tolerances:
        if not 0 < tolerance_deg <= 180:
            raise InputError(f"--tolerances has {tolerance_deg:g}; give degrees, above 0 and up to 180.")
    frames = compare_with_labels(options.labels, options.estimates, options.audio, resolve_array(options.array))
    print_tables(frames.table(tolerance_deg, str(options.labels)) for tolerance_deg in options.tolerances)

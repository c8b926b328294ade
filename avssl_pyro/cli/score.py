"""Scores directions over a recording against its labels: ``avssl score``."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from avssl_pyro.cli.options import parse_options
from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class ScoreOptions:
    """Score directions against labels in every frame of 100 ms.

    The classes of labels are ignored. Give --estimates, --audio for the baselines, or both.
    """

    labels: Path
    """CSV file of the labels, in any of DCASE's formats."""
    estimates: tuple[Path, ...] = ()
    """CSV files written by 'avssl localize --dcase'."""
    audio: Path | None = None
    """Audio of the recording, for the baselines SRP-PHAT, MUSIC and NormMUSIC."""
    array: str = "starss23-mic"
    """Array of --audio: a preset or a YAML file."""
    tolerances_deg: tuple[float, ...] = (10.0, 20.0)
    """Largest errors in degrees that count as correct; each gives one table."""


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError: a file cannot be read, or a tolerance is no angle.
    """
    options = parse_options(ScoreOptions, args)
    for tolerance_deg in options.tolerances_deg:
        if not 0 < tolerance_deg <= 180:
            raise InputError(f"--tolerances-deg has {tolerance_deg:g}; give degrees, above 0 and up to 180.")
    if not options.estimates and options.audio is None:
        raise InputError("give --estimates, files of directions, or --audio, the recording, for the baselines.")
    from avssl_pyro.acoustics.presets import resolve_array
    from avssl_pyro.benchmarks.recording_scores import compare_with_labels
    from avssl_pyro.evaluation.tables import print_tables

    frames = compare_with_labels(options.labels, options.estimates, options.audio, resolve_array(options.array))
    print_tables(frames.table(tolerance_deg, str(options.labels)) for tolerance_deg in options.tolerances_deg)

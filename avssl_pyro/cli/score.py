"""Scores the directions found in a whole recording against its labels."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.benchmarks.label_scores import azimuths_of_frames, score_table
from avssl_pyro.benchmarks.recording_baselines import baselines_of_recording
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.chance import RandomAtTrueCount
from avssl_pyro.evaluation.metrics import Azimuths
from avssl_pyro.evaluation.peaks import PeakSetting
from avssl_pyro.evaluation.report import print_tables
from avssl_pyro.io.audio_stream import AudioFile
from avssl_pyro.io.clip_files import check_channels
from avssl_pyro.io.dcase import FRAME_S, DcaseRow, read_dcase
from avssl_pyro.recordings.recording import Recording

TUNED_DEG = 10.0


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
    labels = read_dcase(options.labels)
    estimates = {str(path): read_dcase(path) for path in options.estimates}
    recording = None if options.audio is None else Recording(options.audio.stem, AudioFile(options.audio))
    count = _num_frames(labels, estimates.values(), recording)
    labelled = azimuths_of_frames(labels, count)
    given = {name: azimuths_of_frames(rows, count) for name, rows in estimates.items()}
    if recording is not None:
        given |= _baselines(options, recording, labelled)
    given["random directions at the true count"] = RandomAtTrueCount().estimate([], labelled)
    title = "{}, " + f"{count} frames, {sum(map(len, labelled))} labelled directions, within " + "{:g}°"
    print_tables([score_table(labelled, given, one, title.format(options.labels, one)) for one in options.tolerances])


def _num_frames(
    labels: Sequence[DcaseRow], estimates: Iterable[Sequence[DcaseRow]], recording: Recording | None
) -> int:
    """Those of the recording, or up to the last source if it is not at hand."""
    rows = [*labels, *(row for each in estimates for row in each)]
    last = max((row.frame + 1 for row in rows), default=0)
    if recording is not None:
        last = max(last, round(recording.duration_s / FRAME_S))
    if not last:
        raise InputError("neither labels nor estimates have a single source; there is nothing to score.")
    return last


def _baselines(options: ScoreOptions, recording: Recording, labelled: Sequence[Azimuths]) -> dict[str, list[Azimuths]]:
    array = resolve_array(options.array)
    check_channels(recording.audio.num_channels, array, str(options.audio))
    ordered = Recording(recording.name, recording.audio, channels=array.channel_indices)
    return baselines_of_recording(ordered, array, labelled, PeakSetting(0.5, 4), float(np.deg2rad(TUNED_DEG)))

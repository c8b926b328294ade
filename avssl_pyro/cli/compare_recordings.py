"""Localizes labelled recordings by sound alone, beside SRP-PHAT, MUSIC and NormMUSIC."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tyro
from attrs import evolve

from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.benchmarks.recordings import NOTES, RecordingsExperiment, comparison_tables
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.baselines import DEFAULT_BAND_HZ
from avssl_pyro.evaluation.metrics import Azimuths
from avssl_pyro.evaluation.peaks import PeakSetting
from avssl_pyro.evaluation.tables import print_tables
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.posterior import SourceThresholds
from avssl_pyro.recordings.labeled_recordings import LabeledRecording, read_labeled_recordings
from avssl_pyro.systems.system import SystemConfig
from avssl_pyro.training.config import PRESETS


@dataclass(frozen=True)
class BaselinePeaks:
    """When a peak of a baseline's spectrum counts as a source, where it is not tuned."""

    threshold: float = 0.5
    """Least height over the spectrum's minimum, relative to its maximum's."""
    most: int = 4
    """Most sources reported."""


@dataclass(frozen=True)
class CompareRecordingsOptions:
    """Compare what is heard in labelled recordings, each of them one clip, without pictures and without training.

    labels.csv in the folder has the columns file and azimuth_deg: the name of a WAV or FLAC file of up to ten seconds,
    and the azimuths of everybody who talks in it, in degrees counter-clockwise from the array's x axis, with blanks
    between them.
    """

    folder: Path
    """Folder with the recordings and labels.csv."""
    array: str = "respeaker4"
    """Array that recorded them: a preset or a YAML file."""
    classes: int = 9
    """Source classes of the model, one of them for noise."""
    rounds: int = 120
    """Most rounds of refinement."""
    pause_db: float = 20.0
    """Frames so far below the loudest of a recording are pauses, and not explained."""
    thresholds: SourceThresholds = field(default_factory=SourceThresholds)
    """When a source class counts as a talker."""
    peaks: BaselinePeaks = field(default_factory=BaselinePeaks)
    baseline_band_hz: tuple[float, float] = DEFAULT_BAND_HZ
    """Frequencies that the baselines search."""
    verbose: bool = False
    """Print the directions given for every recording."""


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError: the folder, its list or a recording cannot be used.
    """
    options = tyro.cli(CompareRecordingsOptions, args=args)
    if min(options.classes, options.rounds) < 1:
        raise InputError(
            f"--classes {options.classes} --rounds {options.rounds}: give at least one class and one round."
        )
    if not options.pause_db > 0:
        raise InputError(f"--pause-db {options.pause_db}: give a positive number of decibels.")
    peaks = options.peaks
    if not 0 <= peaks.threshold <= 1 or peaks.most < 1:
        raise InputError(
            f"--peaks.threshold {peaks.threshold} --peaks.most {peaks.most}: give a height from 0 to 1 and at least "
            "one source."
        )
    # Model and spectrogram are those of the pretrained weights, of which nothing else is used.
    preset = PRESETS["two-cores"]
    model = evolve(preset.model, num_sources=options.classes)
    experiment = RecordingsExperiment(
        SystemConfig(resolve_array(options.array), model, stft=preset.stft),
        RefinementConfig(rounds=options.rounds),
        options.thresholds,
        PeakSetting(peaks.threshold, peaks.most),
        options.pause_db,
        options.baseline_band_hz,
    )
    recordings = read_labeled_recordings(options.folder)
    estimated = experiment.run(recordings)
    if options.verbose:
        _print_each(recordings, estimated)
    print_tables(comparison_tables([np.array(recording.azimuths) for recording in recordings], estimated, NOTES))


def _print_each(recordings: Sequence[LabeledRecording], estimated: dict[str, list[Azimuths]]) -> None:
    for index, recording in enumerate(recordings):
        print(f"{recording.path.name}: {_degrees(recording.azimuths)}")
        for name, azimuths in estimated.items():
            print(f"  {name}: {_degrees(azimuths[index])}")


def _degrees(azimuths: Iterable[float]) -> str:
    """Whole degrees from 0 to 359 in rising order."""
    rounded = sorted(round(float(np.rad2deg(azimuth))) % 360 for azimuth in azimuths)
    return " ".join(str(degrees) for degrees in rounded) or "nobody"

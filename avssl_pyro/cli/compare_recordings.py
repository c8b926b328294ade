"""Localizes labelled recordings by sound alone, beside SRP-PHAT, MUSIC and NormMUSIC."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import tyro
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.benchmarks.posterior_method import PosteriorMethod
from avssl_pyro.benchmarks.recordings import NEAR_DEG, comparison_tables
from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.baselines import DEFAULT_BAND_HZ, default_baselines
from avssl_pyro.evaluation.methods import plain_and_tuned
from avssl_pyro.evaluation.metrics import Azimuths
from avssl_pyro.evaluation.peaks import PeakSetting
from avssl_pyro.evaluation.report import print_tables
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.io.clip_files import read_audio
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.localization.posterior import SourceThresholds
from avssl_pyro.recordings.labeled_recordings import LabeledRecording, read_labeled_recordings
from avssl_pyro.systems.system import SystemConfig, build_system
from avssl_pyro.training.config import PRESETS

OURS = "audio-only refined"
NOTES = (
    f"false: given, but not within {NEAR_DEG:g}° of a labelled direction of its own; mean error: of those within "
    f"{NEAR_DEG:g}°.",
    "Rows 'tuned' have the peak setting that is best on these very files, an advantage that no other row has.",
)


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
    array = resolve_array(options.array)
    recordings = read_labeled_recordings(options.folder)
    clips = [_clip(recording, array) for recording in recordings]
    labelled = [np.array(recording.azimuths) for recording in recordings]
    given = _ours(options, array, clips) | _baselines(options, array, clips, labelled)
    if options.verbose:
        _print_each(recordings, given)
    print_tables(comparison_tables(labelled, given, NOTES))


def _clip(recording: LabeledRecording, array: MicrophoneArray) -> Clip:
    audio_mn = read_audio(recording.path, array)
    if recording.azimuths and not audio_mn.any():
        raise InputError(
            f"{recording.path}: is silent throughout, but its labels name somebody who talks; give another recording, "
            "or leave its field azimuth_deg empty."
        )
    return Clip.without_picture(recording.path.name, audio_mn)


def _ours(
    options: CompareRecordingsOptions, array: MicrophoneArray, clips: Sequence[Clip]
) -> dict[str, list[Azimuths]]:
    """Model and spectrogram are those of the shipped weights, of which nothing else is used."""
    preset = PRESETS["two-cores"]
    model = replace(preset.model, num_sources=options.classes)
    system = build_system(SystemConfig(array, model, stft=preset.stft))
    refinement = RefinementConfig(rounds=options.rounds)
    localizer = Localizer(system, refinement=refinement, audio_only=True, pause_db=options.pause_db)
    # One by one, for they need not be of equal length.
    method = PosteriorMethod(OURS, localizer.posteriors, system.config.grid, batch_size=1)
    heard = method.observe_all(tqdm(clips, desc=OURS))
    return {OURS: [method.decide(posterior, options.thresholds) for posterior in heard]}


def _baselines(
    options: CompareRecordingsOptions, array: MicrophoneArray, clips: Sequence[Clip], labelled: Sequence[Azimuths]
) -> dict[str, list[Azimuths]]:
    given: dict[str, list[Azimuths]] = {}
    fixed = PeakSetting(options.peaks.threshold, options.peaks.most)
    grid = DirectionGrid(PRESETS["two-cores"].model.num_directions)
    for method in default_baselines(array, grid, freq_range_hz=options.baseline_band_hz):
        spectra = method.observe_all(tqdm(clips, desc=method.name))
        given |= plain_and_tuned(method, spectra, labelled, fixed, float(np.deg2rad(NEAR_DEG)))
    return given


def _print_each(recordings: Sequence[LabeledRecording], given: dict[str, list[Azimuths]]) -> None:
    for index, recording in enumerate(recordings):
        print(f"{recording.path.name}: {_degrees(recording.azimuths)}")
        for name, azimuths in given.items():
            print(f"  {name}: {_degrees(azimuths[index])}")


def _degrees(azimuths: Iterable[float]) -> str:
    """Whole degrees from 0 to 359 in rising order."""
    rounded = sorted(round(float(np.rad2deg(azimuth))) % 360 for azimuth in azimuths)
    return " ".join(str(degrees) for degrees in rounded) or "nobody"

"""Runs ``avssl benchmark {recordings, separation, camera}``."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from attrs import evolve

from avssl_pyro.cli.options import DEFAULT_SEED, AssetOptions, Seed, choose_system, parse_options
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.direct_level import DirectLevelRule
from avssl_pyro.training.config import PRESETS

if TYPE_CHECKING:
    from avssl_pyro.evaluation.metrics import Azimuths
    from avssl_pyro.recordings.labeled_recordings import LabeledRecording


@dataclass(frozen=True)
class BaselinePeaks:
    """Untuned conditions under which a peak of a baseline's spectrum is a source."""

    threshold: float = 0.5
    """Least height of a peak above the spectrum's minimum, as a share of the maximum's height."""
    most: int = 4
    """Largest number of sources."""


@dataclass(frozen=True)
class RecordingsOptions:
    """Compare methods on labelled recordings by audio alone, without training.

    Each recording is one clip. The folder's labels.csv has the columns file and azimuth_deg. file is the name of a WAV
    or FLAC file of up to ten seconds. azimuth_deg lists the azimuths of its talkers, separated by blanks, in degrees
    counter-clockwise from the array's x axis.
    """

    recordings: Path
    """Folder of the recordings and labels.csv."""
    array: str = "respeaker4"
    """Array of the recordings: a preset or a YAML file."""
    num_classes: int = 9
    """Number of source classes of the model, one of them for noise."""
    rounds: int = RefinementConfig().rounds
    """Largest number of rounds of refinement."""
    pause_db: float = 20.0
    """Level in decibels below the loudest frame of a recording; quieter frames are pauses and are left out."""
    rule: DirectLevelRule = field(default_factory=DirectLevelRule)
    """Conditions under which a source class counts as a talker."""
    peaks: BaselinePeaks = field(default_factory=BaselinePeaks)
    baseline_band_hz: tuple[float, float] = (500.0, 4000.0)
    """Lowest and highest frequency of the baselines in hertz."""
    verbose: bool = False
    """Print the estimates for every recording."""


def recordings(args: Sequence[str] | None = None) -> None:
    """Runs ``avssl benchmark recordings``.

    Raises:
        InputError: the folder, its list or a recording cannot be used.
    """
    import numpy as np

    options = parse_options(RecordingsOptions, args)
    if min(options.num_classes, options.rounds) < 1:
        raise InputError(
            f"--num-classes {options.num_classes} --rounds {options.rounds}: give at least one class and one round."
        )
    if not options.pause_db > 0:
        raise InputError(f"--pause-db {options.pause_db}: give a positive number of decibels.")
    peaks = options.peaks
    if not 0 <= peaks.threshold <= 1 or peaks.most < 1:
        raise InputError(
            f"--peaks.threshold {peaks.threshold} --peaks.most {peaks.most}: give a height from 0 to 1 and at least "
            "one source."
        )
    from avssl_pyro.acoustics.presets import resolve_array
    from avssl_pyro.benchmarks.recordings import NOTES, RecordingsExperiment, comparison_tables
    from avssl_pyro.evaluation.peaks import PeakSetting
    from avssl_pyro.evaluation.tables import print_tables
    from avssl_pyro.recordings.labeled_recordings import read_labeled_recordings
    from avssl_pyro.systems.system import SystemConfig

    # Model and spectrogram are those of the pretrained weights; the weights are not used.
    preset = PRESETS["two-cores"]
    experiment = RecordingsExperiment(
        SystemConfig(
            resolve_array(options.array), evolve(preset.model, num_sources=options.num_classes), stft=preset.stft
        ),
        RefinementConfig(rounds=options.rounds),
        options.rule,
        PeakSetting(peaks.threshold, peaks.most),
        options.pause_db,
        options.baseline_band_hz,
    )
    labelled = read_labeled_recordings(options.recordings)
    estimated = experiment.run(labelled)
    if options.verbose:
        _print_each(labelled, estimated)
    print_tables(comparison_tables([np.array(recording.azimuths) for recording in labelled], estimated, NOTES))


def _print_each(labelled: "Sequence[LabeledRecording]", estimated: "dict[str, list[Azimuths]]") -> None:
    for index, recording in enumerate(labelled):
        print(f"{recording.path.name}: {_degrees(recording.azimuths)}")
        for name, azimuths in estimated.items():
            print(f"  {name}: {_degrees(azimuths[index])}")


def _degrees(azimuths: Iterable[float]) -> str:
    """Whole degrees from 0 to 359 in rising order."""
    import numpy as np

    rounded = sorted(round(float(np.rad2deg(azimuth))) % 360 for azimuth in azimuths)
    return " ".join(str(degrees) for degrees in rounded) or "nobody"


@dataclass(frozen=True)
class SeparationOptions:
    """Separate two talkers and compare with methods that use the truth.

    Up to two silent people are in each scene. Scores are improvements of SI-SDR over the first microphone in dB:
    against each talker's reverberant image at that microphone, and against the direct sound alone. A talker without a
    source within 10 degrees scores 0. The rows are delay and sum towards the true mouths; filters of the refined
    posterior, also with unfitted masks; filters of one forward pass; and ideal ratio masks from the true power of the
    talkers.
    """

    num_scenes: int = 50
    """Number of mixtures."""
    array: str = "circle6"
    """Array of the mixtures: a preset or a YAML file."""
    checkpoint: Path | None = None
    """Checkpoint of 'avssl train' for this array; by default the pretrained weights."""
    material: Annotated[AssetOptions, tyro.conf.arg(name="")] = field(default_factory=AssetOptions)
    seed: Seed = DEFAULT_SEED


def separation(args: Sequence[str] | None = None) -> None:
    """Runs ``avssl benchmark separation``.

    Raises:
        InputError, OSError: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    options = parse_options(SeparationOptions, args)
    if options.num_scenes < 1:
        raise InputError(f"--num-scenes is {options.num_scenes}; give a number of at least 1.")
    from avssl_pyro.benchmarks.separation import run_separation

    system, array = choose_system(options.checkpoint, options.array)
    material = options.material
    sources = (material.speech_source(), material.person_source(), material.panorama_source())
    run_separation(system, array, sources, options.num_scenes, options.seed, options.array).print()


@dataclass(frozen=True)
class CameraOptions:
    """Estimate yaw and mirroring of simulated cameras of random orientation.

    Every result is stored in --out, and the same command continues where it stopped.
    """

    num_recordings: int = 20
    """Number of recordings."""
    seconds: float = 60.0
    """Length of a recording in seconds, at least 8."""
    array: str = "circle6"
    """Array of the recordings: a preset or a YAML file."""
    checkpoint: Path | None = None
    """Checkpoint of 'avssl train' for this array; by default the pretrained weights."""
    material: Annotated[AssetOptions, tyro.conf.arg(name="")] = field(default_factory=AssetOptions)
    standing_share: float = 0.4
    """Expected share of people who never walk. Two talkers who never walk make the orientation ambiguous: mirroring
    and a turn can exchange their places in the picture."""
    width: int = 576
    """Width of the pictures in pixels, at least 288; the height is half of it."""
    seed: Seed = DEFAULT_SEED
    out: Path = Path("runs/camera")
    """Folder that stores the result of every recording."""


def camera(args: Sequence[str] | None = None) -> None:
    """Runs ``avssl benchmark camera``.

    Raises:
        InputError, OSError: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    from avssl_pyro.simulation.motion import MovingPeopleConfig

    options = parse_options(CameraOptions, args)
    if not 0 <= options.standing_share <= 1:
        raise InputError(f"--standing-share is {options.standing_share:g}; give a share from 0 to 1.")
    if options.num_recordings < 1 or options.seconds < 8 or options.width < 288:
        raise InputError(
            f"--num-recordings {options.num_recordings} --seconds {options.seconds:g} --width {options.width}: give at "
            "least 1 recording, 8 s and 288 columns."
        )
    from avssl_pyro.benchmarks.camera import CameraExperiment, camera_table
    from avssl_pyro.simulation.recordings import Camera
    from avssl_pyro.systems.checkpoint import fingerprint

    system, array = choose_system(options.checkpoint, options.array)
    config = MovingPeopleConfig(standing_share=options.standing_share)
    simulator = options.material.recording_simulator(
        config, options.seconds, options.seed, array, Camera(options.width)
    )
    settings = {
        "system": fingerprint(system),
        "material": str(options.material),
        **{name: getattr(options, name) for name in ("seconds", "array", "standing_share", "width", "seed")},
    }
    trials = CameraExperiment(simulator, system).run_all(options.num_recordings, options.out, settings)
    camera_table(trials, options.array, options.seconds).print()

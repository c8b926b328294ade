"""Prints what tracking adds to single windows, on simulated talkers who walk, pause and pass each other."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import tyro
from tqdm import tqdm

from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.benchmarks.tracking import (
    DetectorConfig,
    RenderedRecordings,
    SimulatedRecordings,
    compare_links,
    tracking_table,
)
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.simulation.motion import MovingTalkersConfig
from avssl_pyro.simulation.moving_source import MovingAudioConfig
from avssl_pyro.systems.config import ModelConfig
from avssl_pyro.systems.system import SystemConfig, build_system
from avssl_pyro.tracking.tracker import TrackingConfig


@dataclass(frozen=True)
class TrackBenchmarkOptions:
    """Compare tracked sources with single windows on the same simulated detections."""

    recordings: int = 10
    """Number of recordings."""
    talkers: MovingTalkersConfig = field(default_factory=MovingTalkersConfig)
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    heard: bool = False
    """Render the talkers in a room and localize their sound window by window, instead of drawing detections."""
    array: str = "circle6"
    """Array that hears them: a preset or a YAML file."""
    classes: int = 5
    """Source classes of the model that localizes what is heard, one of them for noise."""
    rounds: int = 90
    """Most rounds of refinement of what is heard; without a picture to start from it takes many."""
    audio: MovingAudioConfig = field(default_factory=MovingAudioConfig)
    tolerance_deg: float = 10.0
    """Largest error that counts as correct."""
    lag: int = 3
    """Windows that live tracking waits for."""
    seed: int = 0


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process)."""
    options = tyro.cli(TrackBenchmarkOptions, args=args)
    if options.recordings < 1 or options.talkers.seconds < 2 * options.talkers.step_s:
        raise InputError(
            f"--recordings {options.recordings} of {options.talkers.seconds} s: give at least one, of two windows."
        )
    source = _heard(options) if options.heard else _simulated(options)
    recordings = [source.draw(index) for index in tqdm(range(source.count), desc="recordings")]
    scores = compare_links(recordings, options.tracking, float(np.deg2rad(options.tolerance_deg)), options.lag)
    title = f"{options.recordings} recordings of {options.talkers.seconds:g} s, tolerance {options.tolerance_deg:g}°"
    tracking_table(scores, title).print()


def _simulated(options: TrackBenchmarkOptions) -> SimulatedRecordings:
    return SimulatedRecordings(options.talkers, options.detector, options.recordings, options.seed)


def _heard(options: TrackBenchmarkOptions) -> RenderedRecordings:
    system = build_system(SystemConfig(resolve_array(options.array), ModelConfig(num_sources=options.classes)))
    localizer = Localizer(system, refinement=RefinementConfig(rounds=options.rounds), audio_only=True)
    return RenderedRecordings(
        localizer, talkers=options.talkers, audio=options.audio, count=options.recordings, seed=options.seed
    )

"""Runs ``avssl benchmark tracking``, whose options need the simulators and torch."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from avssl_pyro.benchmarks.tracking import DetectorConfig
from avssl_pyro.cli.options import DEFAULT_SEED, Seed, parse_options
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.simulation.motion import MovingTalkersConfig
from avssl_pyro.simulation.moving_source import MovingAudioConfig
from avssl_pyro.systems.config import ModelConfig
from avssl_pyro.tracking.tracker import TrackingConfig

if TYPE_CHECKING:
    from avssl_pyro.benchmarks.tracking import RenderedRecordings, SimulatedRecordings


@dataclass(frozen=True)
class TrackingOptions:
    """Compare tracks with single windows on the same simulated detections."""

    num_recordings: int = 10
    """Number of recordings."""
    talkers: MovingTalkersConfig = field(default_factory=MovingTalkersConfig)
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    rendered: bool = False
    """Render the talkers in a room and localize them window by window, instead of drawing detections."""
    array: str = "circle6"
    """Array of rendered recordings: a preset or a YAML file."""
    num_classes: int = 5
    """Number of source classes of the model for rendered recordings, one of them for noise."""
    rounds: int = RefinementConfig().rounds
    """Largest number of rounds of refinement."""
    audio: MovingAudioConfig = field(default_factory=MovingAudioConfig)
    tolerance_deg: float = 10.0
    """Largest error in degrees that counts as correct."""
    lag: int = 3
    """Number of later windows that online tracking uses."""
    seed: Seed = DEFAULT_SEED


def tracking(args: Sequence[str] | None = None) -> None:
    """Runs ``avssl benchmark tracking``.

    Raises:
        InputError: there is nothing to track.
    """
    import numpy as np

    options = parse_options(TrackingOptions, args)
    if options.num_recordings < 1 or options.talkers.seconds < 2 * options.talkers.step_s:
        raise InputError(
            f"--num-recordings {options.num_recordings} of {options.talkers.seconds} s: give at least one, of two "
            "windows."
        )
    from tqdm import tqdm

    from avssl_pyro.benchmarks.tracking import compare_links, tracking_table

    source = _recording_source(options)
    drawn = [source.draw(index) for index in tqdm(range(source.count), desc="recordings")]
    scores = compare_links(drawn, options.tracking, float(np.deg2rad(options.tolerance_deg)), options.lag)
    title = f"{source.count} recordings of {options.talkers.seconds:g} s, tolerance {options.tolerance_deg:g}°"
    tracking_table(scores, title).print()


def _recording_source(options: TrackingOptions) -> "SimulatedRecordings | RenderedRecordings":
    from avssl_pyro.acoustics.presets import resolve_array
    from avssl_pyro.benchmarks.tracking import RenderedRecordings, SimulatedRecordings
    from avssl_pyro.localization.localizer import Localizer
    from avssl_pyro.systems.system import SystemConfig, build_system

    if not options.rendered:
        return SimulatedRecordings(options.talkers, options.detector, options.num_recordings, options.seed)
    system = build_system(SystemConfig(resolve_array(options.array), ModelConfig(num_sources=options.num_classes)))
    localizer = Localizer(system, refinement=RefinementConfig(rounds=options.rounds), audio_only=True)
    return RenderedRecordings(
        localizer, talkers=options.talkers, audio=options.audio, count=options.num_recordings, seed=options.seed
    )

"""What continuity over time is worth: windows alone, linked to the nearest, and tracked, on the same detections."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.benchmarks.simulated_detections import DetectorConfig, detect
from avssl_pyro.evaluation.tracking_metrics import TrackingScores, tracking_scores
from avssl_pyro.simulation.moving_talkers import MovingTalkersConfig, draw_moving_talkers
from avssl_pyro.tracking.online import OnlineTracker
from avssl_pyro.tracking.tracker import TrackedSource, TrackingConfig, WindowDetections, track, tracked_sources

Windows = Sequence[WindowDetections]
Identified = list[dict[int, float]]


@dataclass(frozen=True)
class TrackedRecording:
    """Truth and detections of a recording.

    Args:
        truth: per window, who sounds and where, radians.
        windows: the detections.
    """

    truth: Sequence[Mapping[int, float]]
    windows: Windows


@dataclass(frozen=True)
class SimulatedRecordings:
    """Recordings drawn without any sound.

    Args:
        talkers, detector: what is drawn.
        count: number of recordings.
        seed: recording i depends on the seed and i alone.
    """

    talkers: MovingTalkersConfig = field(default_factory=MovingTalkersConfig)
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    count: int = 10
    seed: int = 0

    def draw(self, index: int) -> TrackedRecording:
        """TrackedRecording ``index``."""
        rng = np.random.default_rng([self.seed, index])
        talkers = draw_moving_talkers(self.talkers, rng)
        truth = [talkers.window(t) for t in range(len(talkers.times_s))]
        return TrackedRecording(truth, detect(talkers, self.detector, rng))


def alone(windows: Windows) -> Identified:
    """No continuity: the identity of a detection is its place in its own window's list."""
    return [{k: source.azimuth for k, source in enumerate(window.sources)} for window in windows]


def nearest(windows: Windows, within: float) -> Identified:
    """Each detection takes the identity of the nearest one of the window before, or else a new one.

    Args:
        windows: the detections.
        within: largest angle of a link, radians.
    """
    identified: Identified = []
    before: dict[int, float] = {}
    count = 0
    for window in windows:
        now: dict[int, float] = {}
        free = dict(before)
        for source in window.sources:
            gaps = {identity: abs(float(wrap_angle(azimuth - source.azimuth))) for identity, azimuth in free.items()}
            identity = min(gaps, key=lambda one: gaps[one], default=None)
            if identity is None or gaps[identity] > within:
                identity, count = count, count + 1
            free.pop(identity, None)
            now[identity] = source.azimuth
        before = now
        identified.append(now)
    return identified


def tracked(windows: Windows, config: TrackingConfig) -> Identified:
    """Tracks given the whole recording."""
    return [_identities(found) for found in tracked_sources(windows, track(windows, config), config)]


def tracked_live(windows: Windows, config: TrackingConfig, lag: int) -> Identified:
    """Tracks given ``lag`` later windows."""
    tracker = OnlineTracker(config, step_s=windows[1].time_s - windows[0].time_s, lag=lag)
    answers = [tracker.push(window) for window in windows]
    return [_identities(found) for found in [*answers, *tracker.finish()] if found is not None]


def _identities(found: Sequence[TrackedSource]) -> dict[int, float]:
    return {source.track_id: source.azimuth for source in found}


def compare(
    recordings: Sequence[TrackedRecording], config: TrackingConfig, tolerance: float, lag: int
) -> dict[str, TrackingScores]:
    """Scores of every way to link the same detections, by its name.

    Args:
        recordings: truth and detections.
        config: of the tracks.
        tolerance: largest error that counts as correct, radians.
        lag: of the live tracks, in windows.
    """
    ways = {
        "windows alone": alone,
        "linked to nearest": lambda windows: nearest(windows, 2 * tolerance),
        f"tracked live, lag {lag}": lambda windows: tracked_live(windows, config, lag),
        "tracked": lambda windows: tracked(windows, config),
    }
    return {
        name: tracking_scores([(one.truth, link(one.windows)) for one in recordings], tolerance)
        for name, link in ways.items()
    }

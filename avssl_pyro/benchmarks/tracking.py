"""Benefit of tracking: windows alone, linked to the nearest, and tracked, on the same detections.

Detections are drawn around walking talkers, or localized in sound that is rendered in a room.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.clip import SAMPLE_RATE, Clip
from avssl_pyro.evaluation.tables import Column, Table
from avssl_pyro.evaluation.tracking_metrics import TrackingScores, tracking_scores
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.localization.posterior import LocalizedSource
from avssl_pyro.simulation.motion import MovingTalkers, MovingTalkersConfig, draw_moving_talkers
from avssl_pyro.simulation.moving_source import MovingAudioConfig, render_moving_talkers
from avssl_pyro.tracking.online import OnlineTracker
from avssl_pyro.tracking.recording_localizer import localize_windows
from avssl_pyro.tracking.tracker import TrackedSource, TrackingConfig, WindowDetections, track, tracked_sources

Windows = Sequence[WindowDetections]
Identified = list[dict[int, float]]


@dataclass(frozen=True)
class DetectorConfig:
    """Errors of a simulated localizer.

    Args:
        std_deg: standard deviation of an azimuth, degrees.
        miss: share of sounding talkers that are not found.
        clutter: mean number of false detections in a window, uniform over azimuth.
        merge_deg: largest angle, degrees, between talkers that are found as one.
    """

    std_deg: float = 3.0
    miss: float = 0.12
    clutter: float = 0.1
    merge_deg: float = 12.0


def draw_detections(talkers: MovingTalkers, config: DetectorConfig, rng: np.random.Generator) -> list[WindowDetections]:
    """Draws detections of every window: blurred, missed, merged, among clutter."""
    return [
        WindowDetections(float(time_s), _detected(talkers.window(t), config, rng))
        for t, time_s in enumerate(talkers.times_s)
    ]


def _detected(truth: dict[int, float], config: DetectorConfig, rng: np.random.Generator) -> tuple[LocalizedSource, ...]:
    found: list[float] = []
    for azimuth in truth.values():
        offsets = wrap_angle(azimuth - np.array(found))
        near = np.flatnonzero(np.abs(offsets) < np.deg2rad(config.merge_deg))
        if len(near):
            found[near[0]] += float(offsets[near[0]]) / 2
        else:
            found.append(azimuth)
    kept = [azimuth for azimuth in found if rng.uniform() >= config.miss]
    azimuths = [azimuth + np.deg2rad(config.std_deg) * rng.standard_normal() for azimuth in kept]
    azimuths += list(rng.uniform(-np.pi, np.pi, rng.poisson(config.clutter)))
    level = 0.8 / max(len(azimuths), 1)
    return tuple(
        LocalizedSource(float(wrap_angle(azimuth)), np.deg2rad(2.0), level, 0.01, level, k)
        for k, azimuth in enumerate(azimuths)
    )


@dataclass(frozen=True)
class TrackedRecording:
    """Truth and detections of a recording.

    Args:
        truth: azimuths of the sounding talkers per window, by talker, radians.
        windows: detections.
    """

    truth: Sequence[Mapping[int, float]]
    windows: Windows


@dataclass(frozen=True)
class SimulatedRecordings:
    """Recordings drawn without any sound.

    Args:
        talkers, detector: distributions of talkers and of their detections.
        count: number of recordings.
        seed: recording i depends on the seed and i alone.
    """

    talkers: MovingTalkersConfig = field(default_factory=MovingTalkersConfig)
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    count: int = 10
    seed: int = 0

    def draw(self, index: int) -> TrackedRecording:
        """Recording ``index``."""
        rng = np.random.default_rng([self.seed, index])
        talkers = draw_moving_talkers(self.talkers, rng)
        truth = [talkers.window(t) for t in range(len(talkers.times_s))]
        return TrackedRecording(truth, draw_detections(talkers, self.detector, rng))


@dataclass(frozen=True)
class RenderedRecordings:
    """Walking talkers rendered in a room and localized window by window, by sound alone.

    Args:
        localizer: localizer with its thresholds; its picture is black.
        talkers, audio: distributions of talkers and of their sound.
        window_s: length of a window, seconds.
        count: number of recordings.
        seed: recording i depends on the seed and i alone.
    """

    localizer: Localizer
    talkers: MovingTalkersConfig = field(default_factory=MovingTalkersConfig)
    audio: MovingAudioConfig = field(default_factory=MovingAudioConfig)
    window_s: float = 0.5
    count: int = 3
    seed: int = 0

    def draw(self, index: int) -> TrackedRecording:
        """Recording ``index``; a talker is in the windows that it fills half of, at its azimuth in their middle."""
        rng = np.random.default_rng([self.seed, index])
        talkers = draw_moving_talkers(self.talkers, rng)
        audio_mn = render_moving_talkers(talkers, self.localizer.config.array, self.audio, rng)
        instants = ceil(self.window_s / self.talkers.step_s)
        starts = range(len(talkers.times_s) - instants + 1)
        truth = [_truth(talkers, slice(t, t + instants)) for t in starts]
        return TrackedRecording(truth, self._windows(audio_mn, [float(talkers.times_s[t]) for t in starts]))

    def _windows(self, audio_mn: npt.NDArray[np.float32], starts_s: list[float]) -> list[WindowDetections]:
        length = round(self.window_s * SAMPLE_RATE)
        firsts = [round(start_s * SAMPLE_RATE) for start_s in starts_s]
        clips = [Clip.from_audio(str(first), audio_mn[:, first : first + length]) for first in firsts]
        return list(localize_windows(zip(starts_s, clips, strict=True), self.localizer, self.window_s))


def _truth(talkers: MovingTalkers, instants: slice) -> dict[int, float]:
    fills_s = talkers.sounding_st[:, instants].mean(axis=1) >= 0.5
    middle = (instants.start + instants.stop) // 2
    return {int(s): float(talkers.azimuths_st[s, middle]) for s in np.flatnonzero(fills_s)}


def alone(windows: Windows) -> Identified:
    """Identities without continuity: the place of a detection in the list of its window."""
    return [{k: source.azimuth for k, source in enumerate(window.sources)} for window in windows]


def nearest(windows: Windows, within: float) -> Identified:
    """Identities of the nearest detection in the window before, or else new ones.

    Args:
        windows: detections.
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
    """Identities of tracks, given the whole recording."""
    return [_identities(found) for found in tracked_sources(windows, track(windows, config), config)]


def tracked_live(windows: Windows, config: TrackingConfig, lag: int) -> Identified:
    """Identities of tracks, given ``lag`` later windows."""
    tracker = OnlineTracker(config, step_s=windows[1].time_s - windows[0].time_s, lag=lag)
    answers = [tracker.update(window) for window in windows]
    return [_identities(found) for found in [*answers, *tracker.finish()] if found is not None]


def _identities(found: Sequence[TrackedSource]) -> dict[int, float]:
    return {source.track_id: source.azimuth for source in found}


def compare_links(
    recordings: Sequence[TrackedRecording], config: TrackingConfig, tolerance: float, lag: int
) -> dict[str, TrackingScores]:
    """Scores of every way to link the same detections, by name.

    Args:
        recordings: truth and detections.
        config: parameters of the tracks.
        tolerance: largest error that counts as correct, radians.
        lag: lag of the live tracks, in windows.
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


def tracking_table(scores: Mapping[str, TrackingScores], title: str) -> Table[tuple[str, TrackingScores]]:
    """One line for each way to link detections."""
    columns: list[Column[tuple[str, TrackingScores]]] = [
        Column("sources", lambda row: row[0]),
        Column("F", lambda row: row[1].f_measure, "{:.3f}"),
        Column("precision", lambda row: row[1].precision, "{:.3f}"),
        Column("recall", lambda row: row[1].recall, "{:.3f}"),
        Column("error", lambda row: float(np.rad2deg(row[1].localization_error)), "{:.2f}°"),
        Column("switches", lambda row: row[1].switches),
        Column("fragments", lambda row: row[1].fragments),
        Column("MOTA", lambda row: row[1].mota, "{:.3f}"),
    ]
    return Table(list(scores.items()), columns, title)

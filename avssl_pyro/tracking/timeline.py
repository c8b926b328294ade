"""Sources of a recording over time, interpolated between localized windows."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.tracking.tracker import Track, WindowDetections, tracked_sources

# Largest turn in radians of a person between two windows; sources of one name that turn further are distinct.
MAX_TURN = np.deg2rad(30.0)


@dataclass(frozen=True)
class IdentifiedSource:
    """Sounding source at one time.

    Args:
        name: number of its track, or of its source class without tracking.
        azimuth: direction of arrival in radians, counter-clockwise from straight ahead.
        azimuth_std: posterior standard deviation of the azimuth in radians.
        level: mixing level, the share of time-frequency bins the source dominates.
    """

    name: int
    azimuth: float
    azimuth_std: float
    level: float

    @property
    def azimuth_deg(self) -> float:
        """Direction of arrival in degrees: 0 is straight ahead, +90 left."""
        return math.degrees(self.azimuth)

    @property
    def azimuth_std_deg(self) -> float:
        """Posterior standard deviation of the azimuth in degrees."""
        return math.degrees(self.azimuth_std)


@dataclass(frozen=True)
class TimelineFrame:
    """Sounding sources of one window.

    Args:
        time_s: time of the window's middle in seconds from the start of the recording.
        sources: sources of the window.
    """

    time_s: float
    sources: tuple[IdentifiedSource, ...]


@dataclass(frozen=True)
class Timeline:
    """Localized windows of a recording, in order.

    Args:
        frames: sources of each window.
        hop_s: usual time between frames in seconds.
        reach_s: time in seconds by which sources extend to each side of a frame without a neighbour; half a window.

    >>> ahead, left = (IdentifiedSource(1, azimuth, azimuth_std=0.02, level=0.4) for azimuth in (0.0, 0.2))
    >>> frames = (TimelineFrame(1.0, (ahead,)), TimelineFrame(2.0, (left,)))
    >>> round(Timeline(frames, hop_s=1.0, reach_s=0.5).at(1.5)[0].azimuth, 3)
    0.1
    """

    frames: tuple[TimelineFrame, ...]
    hop_s: float
    reach_s: float

    @property
    def names(self) -> tuple[int, ...]:
        """All names in order of appearance."""
        return tuple(dict.fromkeys(source.name for frame in self.frames for source in frame.sources))

    def at(self, time_s: float) -> tuple[IdentifiedSource, ...]:
        """Returns the sources at a time, interpolated between neighbouring frames.

        A source of only one of these frames extends over half of the time between them.

        Args:
            time_s: time in seconds from the start of the recording.
        """
        index = bisect_right(self.frames, time_s, key=lambda frame: frame.time_s)
        around = self.frames[max(index - 1, 0) : index + 1]
        if len(around) < 2 or around[1].time_s - around[0].time_s > 1.5 * self.hop_s:
            nearest = min(around, key=lambda frame: abs(frame.time_s - time_s), default=None)
            reached = nearest is not None and abs(nearest.time_s - time_s) <= self.reach_s + 1e-6
            return nearest.sources if nearest is not None and reached else ()
        before, after = around
        share = (time_s - before.time_s) / (after.time_s - before.time_s)
        nearer, other = (before, after) if share < 0.5 else (after, before)
        others = {source.name: source for source in other.sources}
        weight = min(share, 1 - share)
        return tuple(_between(source, others.get(source.name), weight) for source in nearer.sources)


def _between(near: IdentifiedSource, far: IdentifiedSource | None, weight: float) -> IdentifiedSource:
    """Interpolates from ``near`` towards ``far`` along the shorter arc."""
    if far is None:
        return near
    turn = float(wrap_angle(far.azimuth - near.azimuth))
    if abs(turn) > MAX_TURN:
        return near
    return IdentifiedSource(
        near.name,
        float(wrap_angle(near.azimuth + weight * turn)),
        (1 - weight) * near.azimuth_std + weight * far.azimuth_std,
        (1 - weight) * near.level + weight * far.level,
    )


def timeline_of_windows(windows: Sequence[WindowDetections], hop_s: float, reach_s: float) -> Timeline:
    """Returns the timeline of windows without tracking, with source classes as names.

    Args:
        windows: detections in order of time.
        hop_s: usual time between windows in seconds.
        reach_s: time in seconds as in :class:`Timeline`.
    """
    frames = tuple(
        TimelineFrame(
            window.time_s,
            tuple(IdentifiedSource(s.source_class, s.azimuth, s.azimuth_std, s.level) for s in window.sources),
        )
        for window in windows
    )
    return Timeline(frames, hop_s, reach_s)


def timeline_of_tracks(
    windows: Sequence[WindowDetections], tracks: Sequence[Track], hop_s: float, reach_s: float
) -> Timeline:
    """Returns the timeline of tracks, with their numbers as names.

    Args:
        windows: detections that were tracked.
        tracks: result of :func:`avssl_pyro.tracking.tracker.track`.
        hop_s: usual time between windows in seconds.
        reach_s: time in seconds as in :class:`Timeline`.
    """
    frames = tuple(
        TimelineFrame(
            window.time_s, tuple(IdentifiedSource(s.track_id, s.azimuth, s.azimuth_std, s.level) for s in sources)
        )
        for window, sources in zip(windows, tracked_sources(windows, tracks), strict=True)
    )
    return Timeline(frames, hop_s, reach_s)

"""What a recording's sources do over time, at any moment between the windows that were localized."""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from avssl_pyro.acoustics.grid import wrap_angle

# Faster than anybody walks around a robot between two windows: one name, two places (radians).
MAX_TURN = np.deg2rad(30.0)


@dataclass(frozen=True)
class NamedSource:
    """A sounding object at one moment; angles in radians.

    Args:
        name: number that stays with the object: of its track, or of its source class where nothing was tracked.
        azimuth: direction of arrival, counter-clockwise from straight ahead.
        azimuth_std: posterior standard deviation of the azimuth.
        level: mixing level, the share of time-frequency bins the source dominates.
    """

    name: int
    azimuth: float
    azimuth_std: float
    level: float


@dataclass(frozen=True)
class Moment:
    """The sounding objects in the window around a time (seconds from the recording's start)."""

    time_s: float
    sources: tuple[NamedSource, ...]


@dataclass(frozen=True)
class Timeline:
    """Moments of a recording, evenly spaced and in order.

    Args:
        moments: what was found.
        hop_s: time from one moment to the next.
        reach_s: how long before the first and after the last moment its sources are still shown; half a window.
    """

    moments: tuple[Moment, ...]
    hop_s: float
    reach_s: float

    @property
    def names(self) -> tuple[int, ...]:
        """Every name, in order of appearance."""
        return tuple(dict.fromkeys(source.name for moment in self.moments for source in moment.sources))

    def at(self, time_s: float) -> tuple[NamedSource, ...]:
        """Sources at a time; those that two neighbouring moments share move evenly from one to the other.

        A source of one of the two only lasts for half of the time between them.
        """
        after_index = bisect_right(self.moments, time_s, key=lambda moment: moment.time_s)
        before = self.moments[after_index - 1] if after_index else None
        after = self.moments[after_index] if after_index < len(self.moments) else None
        if before is None or after is None:
            edge = before or after
            near = edge is not None and abs(time_s - edge.time_s) <= self.reach_s + 1e-6
            return edge.sources if edge is not None and near else ()
        share = (time_s - before.time_s) / (after.time_s - before.time_s)
        nearer, other = (before, after) if share < 0.5 else (after, before)
        others = {source.name: source for source in other.sources}
        weight = min(share, 1 - share)
        return tuple(_between(source, others.get(source.name), weight) for source in nearer.sources)


def _between(near: NamedSource, far: NamedSource | None, weight: float) -> NamedSource:
    """``near`` moved towards ``far`` by a share of the way, along the shorter arc."""
    if far is None:
        return near
    turn = float(wrap_angle(far.azimuth - near.azimuth))
    if abs(turn) > MAX_TURN:
        return near
    return NamedSource(
        near.name,
        float(wrap_angle(near.azimuth + weight * turn)),
        (1 - weight) * near.azimuth_std + weight * far.azimuth_std,
        (1 - weight) * near.level + weight * far.level,
    )

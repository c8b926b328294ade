"""Tracking by detection, which links sources over windows and removes clutter."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.errors import InputError
from avssl_pyro.localization.posterior import LocalizedSource
from avssl_pyro.models.tracking.detection import DetectionModel
from avssl_pyro.models.tracking.motion import TrackPrior
from avssl_pyro.tracking.hmm_filter import smooth
from avssl_pyro.tracking.multi_target import Chain, MultiTargetConfig, MultiTargetFilter

Array = npt.NDArray[np.float64]
Columns = tuple[Array, Array, Array, Array, Array, Array]


@dataclass(frozen=True)
class WindowDetections:
    """Detections of one window, at a low threshold that avoids misses.

    Args:
        time_s: time of the window's middle in seconds.
        sources: detected sources.
    """

    time_s: float
    sources: tuple[LocalizedSource, ...]


@dataclass(frozen=True)
class TrackingConfig:
    """Settings of the tracker: models of sources and detections, and thresholds.

    Args:
        prior: prior of motion, pauses, births and deaths.
        detection: model of missed detections and clutter.
        bank: settings of the end and merging of sources.
        num_directions: number D of directions in the tracks' grid; a coarse grid overestimates the speed of sources.
        confirm: least posterior probability that a reported track is a source.
        sounding: least posterior probability that a source reported in a window sounds.
    """

    prior: TrackPrior = field(default_factory=TrackPrior)
    detection: DetectionModel = field(default_factory=DetectionModel)
    bank: MultiTargetConfig = field(default_factory=MultiTargetConfig)
    num_directions: int = 144
    confirm: float = 0.9
    sounding: float = 0.5

    @property
    def grid(self) -> DirectionGrid:
        return DirectionGrid(self.num_directions)

    def new_bank(self) -> MultiTargetFilter:
        return MultiTargetFilter(self.grid, self.prior, self.detection, self.bank)


@dataclass(frozen=True)
class Track:
    """One source over T windows from its first detection to its last, with pauses.

    Args:
        id: number of the source, from 0 in the order of first detections.
        times_s: times of the windows in seconds, (T,).
        azimuths: posterior means in radians, (T,).
        azimuth_stds: posterior standard deviations in radians, (T,).
        levels: mixing levels, (T,), interpolated where the source was not detected.
        presence: posterior probability that the source exists, (T,).
        sounding: posterior probability that the source sounds, (T,).
    """

    id: int
    times_s: Array
    azimuths: Array
    azimuth_stds: Array
    levels: Array
    presence: Array
    sounding: Array

    @property
    def start_s(self) -> float:
        return float(self.times_s[0])

    @property
    def end_s(self) -> float:
        return float(self.times_s[-1])


@dataclass(frozen=True)
class TrackedSource:
    """Source that sounds in a window.

    Args:
        track_id: number of its track.
        azimuth, azimuth_std: posterior mean and standard deviation of the azimuth in radians.
        level: mixing level.
    """

    track_id: int
    azimuth: float
    azimuth_std: float
    level: float


def track(windows: Sequence[WindowDetections], config: TrackingConfig | None = None) -> tuple[Track, ...]:
    """Returns the tracks of a recording, given all windows, in order of their starts.

    Args:
        windows: detections in order of time.
        config: settings; by default for talkers in a room.

    Raises:
        InputError: times do not rise, or a value is not a finite number.
    """
    config = config or TrackingConfig()
    check_windows(windows)
    times_s = np.array([window.time_s for window in windows])
    steps_s = np.diff(times_s)
    usual_s = float(np.median(steps_s)) if len(steps_s) else 1.0
    bank = config.new_bank()
    found: list[Columns] = []
    for window, step_s in zip(windows, [usual_s, *steps_s], strict=False):
        add_window(bank, window, float(step_s))
        found += _take_ended(bank, windows, config)
    bank.finish()
    found += _take_ended(bank, windows, config)
    return tuple(Track(number, *columns) for number, columns in enumerate(sorted(found, key=lambda one: one[0][0])))


def tracked_sources(
    windows: Sequence[WindowDetections], tracks: Sequence[Track], config: TrackingConfig | None = None
) -> tuple[tuple[TrackedSource, ...], ...]:
    """Returns the sounding sources of every window, loudest first.

    Args:
        windows, config: arguments of :func:`track`.
        tracks: result of :func:`track`.
    """
    least = (config or TrackingConfig()).sounding
    index_of = {window.time_s: t for t, window in enumerate(windows)}
    sources: list[list[TrackedSource]] = [[] for _ in windows]
    for one in tracks:
        for time_s, azimuth, std, level, sounding in zip(
            one.times_s, one.azimuths, one.azimuth_stds, one.levels, one.sounding, strict=True
        ):
            if sounding >= least:
                sources[index_of[float(time_s)]].append(TrackedSource(one.id, float(azimuth), float(std), float(level)))
    return tuple(tuple(sorted(found, key=lambda source: -source.level)) for found in sources)


def check_windows(windows: Sequence[WindowDetections]) -> None:
    """Raises InputError for times that do not rise or values that are not finite."""
    for t, window in enumerate(windows):
        if not np.isfinite(window.time_s) or (t and window.time_s <= windows[t - 1].time_s):
            raise InputError(
                f"tracking: window {t} is at {window.time_s} s; the times of windows must be finite and rise."
            )
        for source in window.sources:
            if not np.isfinite([source.azimuth, source.azimuth_std, source.level]).all() or source.azimuth_std < 0:
                raise InputError(
                    f"tracking: the window at {window.time_s} s has a source with azimuth {source.azimuth} rad, "
                    f"standard deviation {source.azimuth_std} and level {source.level}; finite numbers are needed."
                )


def add_window(bank: MultiTargetFilter, window: WindowDetections, step_s: float) -> None:
    """Adds a window to a filter."""
    azimuth_n = np.array([source.azimuth for source in window.sources], dtype=np.float64)
    std_n = np.array([source.azimuth_std for source in window.sources], dtype=np.float64)
    bank.add(window.time_s, step_s, azimuth_n, std_n)


def _take_ended(bank: MultiTargetFilter, windows: Sequence[WindowDetections], config: TrackingConfig) -> list[Columns]:
    """Returns the tracks of ended chains and removes these to free memory."""
    tracks = [_track_of(chain, windows, config) for chain in bank.ended]
    bank.ended = []
    return [track for track in tracks if track is not None]


def _track_of(chain: Chain, windows: Sequence[WindowDetections], config: TrackingConfig) -> Columns | None:
    """Returns the columns of a chain's track, or None if it is clutter."""
    grid, num = config.grid, len(chain.steps)
    presence, sounding, azimuths, stds = (np.zeros(num) for _ in range(4))
    levels = np.full(num, np.nan)
    for t, belief in zip(reversed(range(num)), smooth(chain.steps), strict=True):
        presence[t], sounding[t] = belief.presence, belief.sounding_d.sum()
        azimuths[t], stds[t] = belief.direction(grid)
        levels[t] = detected_level(windows[chain.first + t], chain.shares_tnd[t] @ belief.sounding_d)
    measured = np.flatnonzero(np.isfinite(levels))
    loud = np.flatnonzero(sounding >= config.sounding)
    if presence[0] < config.confirm or not len(measured) or not len(loud):
        return None
    end = int(loud[-1]) + 1
    levels = np.interp(np.arange(num), measured, levels[measured])
    times_s = np.array([windows[chain.first + t].time_s for t in range(num)])
    return times_s[:end], azimuths[:end], stds[:end], levels[:end], presence[:end], sounding[:end]


def detected_level(window: WindowDetections, weight_n: npt.NDArray[np.floating]) -> float:
    """Returns the mean level of detections, weighted by their assignment to a source.

    Args:
        window: detections of the window.
        weight_n: probabilities that the detections belong to the source, (N,).

    Returns:
        The level, or NaN if the probabilities sum to less than 0.5.
    """
    total = float(weight_n.sum())
    if total < 0.5:
        return float("nan")
    return float(weight_n @ np.array([source.level for source in window.sources])) / total

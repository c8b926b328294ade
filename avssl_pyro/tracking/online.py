"""Online tracking of sources with a fixed lag."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from avssl_pyro.errors import InputError
from avssl_pyro.tracking.hmm_filter import smooth
from avssl_pyro.tracking.multi_target import Chain
from avssl_pyro.tracking.tracker import (
    TrackedSource,
    TrackingConfig,
    WindowDetections,
    add_window,
    check_windows,
    detected_level,
)


@dataclass
class _ReportedSource:
    """Track id of a reported source, and its level at the last detection."""

    id: int
    level: float


class OnlineTracker:
    """Fixed-lag form of :func:`avssl_pyro.tracking.tracker.track`.

    Memory and time per window do not grow with the length of the recording.

    Raises:
        InputError: the lag is negative, or the step is not positive.

    Args:
        config: settings of the tracker; by default for talkers in a room.
        step_s: usual time between windows in seconds.
        lag: number of later windows that the sources of a window depend on. With a lag of 0, a missed detection is
            bridged only after the next detection.
    """

    def __init__(self, config: TrackingConfig | None = None, step_s: float = 0.1, lag: int = 3) -> None:
        if lag < 0 or not (np.isfinite(step_s) and step_s > 0):
            raise InputError(
                f"online tracking: a lag of {lag} windows of {step_s} s; give 0 or more, and positive seconds."
            )
        self.config = config or TrackingConfig()
        self.step_s, self.lag = step_s, lag
        self._bank = self.config.new_bank()
        self._recent: deque[WindowDetections] = deque(maxlen=lag + 1)
        self._reported: dict[Chain, _ReportedSource] = {}
        self._num_reported = 0

    def update(self, window: WindowDetections) -> tuple[TrackedSource, ...] | None:
        """Adds a window; returns the sources of the window ``lag`` before it, or None.

        Args:
            window: detections of the next window.

        Raises:
            InputError: the time does not rise, or a value is not a finite number.
        """
        last = self._recent[-1] if self._recent else None
        check_windows([window] if last is None else [last, window])
        self._recent.append(window)
        add_window(self._bank, window, self.step_s if last is None else window.time_s - last.time_s)
        if self._bank.num_windows <= self.lag:
            return None
        return self._sources_at(self._bank.num_windows - 1 - self.lag)

    def finish(self) -> list[tuple[TrackedSource, ...]]:
        """Returns the sources of the last ``lag`` windows; for one call at the end."""
        end = self._bank.num_windows
        return [self._sources_at(t) for t in range(max(end - self.lag, 0), end)]

    def _sources_at(self, t: int) -> tuple[TrackedSource, ...]:
        bank = self._bank
        window = self._recent[t - bank.num_windows]
        sources = []
        for chain in bank.ended + bank.active:
            if chain.first <= t < chain.first + len(chain.steps):
                chain.trim(t)
                source = self._source(chain, window)
                sources += [source] if source is not None else []
        bank.ended = [chain for chain in bank.ended if chain.first + len(chain.steps) > t + 1]
        self._reported = {
            chain: reported for chain, reported in self._reported.items() if chain in {*bank.active, *bank.ended}
        }
        return tuple(sorted(sources, key=lambda source: -source.level))

    def _source(self, chain: Chain, window: WindowDetections) -> TrackedSource | None:
        """Returns the source of a chain in its first window; None if silent or clutter."""
        *_, belief = smooth(chain.steps)
        if belief.presence < self.config.confirm or belief.sounding_d.sum() < self.config.sounding:
            return None
        level = detected_level(window, chain.shares_tnd[0] @ belief.sounding_d)
        if chain not in self._reported:
            self._reported[chain] = _ReportedSource(self._num_reported, level if np.isfinite(level) else 0.0)
            self._num_reported += 1
        reported = self._reported[chain]
        reported.level = level if np.isfinite(level) else reported.level
        azimuth, std = belief.direction(self.config.grid)
        return TrackedSource(reported.id, azimuth, std, reported.level)

"""Localization along a recording: windows in, detections out, a few windows in memory at a time."""

from collections.abc import Iterable, Iterator
from itertools import islice

from avssl_pyro.clip import Clip
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.localization.posterior import SourceThresholds, select_sources
from avssl_pyro.tracking.tracker import WindowDetections


def detect(
    windows: Iterable[tuple[float, Clip]],
    localizer: Localizer,
    thresholds: SourceThresholds,
    *,
    duration_s: float = 1.0,
    batch_size: int = 8,
) -> Iterator[WindowDetections]:
    """Localizes windows in order, in batches.

    Args:
        windows: start times (seconds) and clips of equal length.
        localizer: what localizes them.
        thresholds: what counts as a source.
        duration_s: length of the clips; detections are stamped with the middle of their window.
        batch_size: windows that are in memory and localized together.

    Raises:
        InputError: a clip's channels are not those of the system's array.
    """
    windows = iter(windows)
    grid = localizer.config.grid
    while batch := list(islice(windows, batch_size)):
        posteriors = localizer.posteriors([clip for _, clip in batch])
        for (start_s, _), posterior in zip(batch, posteriors, strict=True):
            yield WindowDetections(start_s + duration_s / 2, select_sources(posterior, grid, thresholds))

"""Peaks of a spatial spectrum on the circle."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.evaluation.metrics import Azimuths

# A spectrum this even, relative to its maximum, is rounding noise around a constant: silence has no direction.
FLATNESS = 1e-9


@dataclass(frozen=True)
class PeakSetting:
    """Conditions under which a peak counts as a source.

    Args:
        threshold: smallest height over the spectrum's minimum, relative to that of its maximum, from 0 to 1.
        max_peaks: largest number of sources, strongest first.
    """

    threshold: float
    max_peaks: int


def pick_peaks(spectrum_d: npt.NDArray[np.float64], grid: DirectionGrid, setting: PeakSetting) -> Azimuths:
    """Azimuths of the local maxima of a circular spectrum, (D,), radians, strongest first.

    A peak between two directions is placed by the parabola through the maximum and its two neighbours. A flat spectrum
    has no peaks, a plateau has one.
    """
    low, high = float(spectrum_d.min()), float(spectrum_d.max())
    if high - low <= FLATNESS * max(abs(high), abs(low)):
        return np.empty(0)
    height_d = (spectrum_d - low) / (high - low)
    before_d, after_d = np.roll(height_d, 1), np.roll(height_d, -1)
    is_peak_d = (height_d >= before_d) & (height_d > after_d) & (height_d >= setting.threshold)
    peaks = np.flatnonzero(is_peak_d)
    peaks = peaks[np.argsort(-height_d[peaks], kind="stable")][: setting.max_peaks]
    # The curvature cannot be 0: a peak is strictly higher than one neighbour and no lower than the other.
    curvature = before_d[peaks] - 2 * height_d[peaks] + after_d[peaks]
    shift = 0.5 * (before_d[peaks] - after_d[peaks]) / curvature
    # Directions fall in azimuth from left to right, hence the minus.
    return wrap_angle(grid.azimuths[peaks] - shift * grid.spacing)

"""Calibration of the posterior spread of azimuths: coverage, reliability by bins, and a fitted scale."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.evaluation.matching import Matching, angular_errors, gate_then_assign
from avssl_pyro.localization.posterior import LocalizedSource

# Shares of a normal distribution within one and two standard deviations.
ONE_STD, TWO_STD = 0.6827, 0.9545
# Wider than the headline tolerance: a tight gate would hide the errors that a spread should predict.
GATE_DEG = 20.0
MAX_BINS = 5


@dataclass(frozen=True)
class SpreadErrors:
    """Matched sources, one entry each.

    Args:
        errors_p: absolute azimuth errors, (P,), radians.
        stds_p: posterior standard deviations of the same azimuths, (P,), radians.
    """

    errors_p: npt.NDArray[np.float64]
    stds_p: npt.NDArray[np.float64]


@dataclass(frozen=True)
class ReliabilityBin:
    """Matched sources of similar predicted spread; radians.

    Args:
        low, high: least and largest predicted standard deviation.
        predicted: root mean square of the predicted standard deviations.
        observed: root mean square of the errors.
        within_one: share of errors within one standard deviation.
        sources: number of sources.
    """

    low: float
    high: float
    predicted: float
    observed: float
    within_one: float
    sources: int


@dataclass(frozen=True)
class Calibration:
    """Coverage of the errors of test scenes by predicted spreads.

    Args:
        sources: number of matched sources.
        within_one, within_two: shares of errors within one and two predicted standard deviations.
        scale: factor fitted on validation scenes, see :func:`fit_scale`.
        scaled_one, scaled_two: shares within one and two standard deviations after scaling.
        bins: predicted and observed spread, unscaled.
    """

    sources: int
    within_one: float
    within_two: float
    scale: float
    scaled_one: float
    scaled_two: float
    bins: tuple[ReliabilityBin, ...]


def match_spreads(
    references: Sequence[npt.ArrayLike],
    sources: Sequence[Sequence[LocalizedSource]],
    tolerance: float = float(np.deg2rad(GATE_DEG)),
    matching: Matching = gate_then_assign,
) -> SpreadErrors:
    """Errors and predicted spreads of the sources matched to a true azimuth.

    Args:
        references: per clip, the true azimuths, radians.
        sources: per clip, what was found.
        tolerance: errors beyond it are misses, not errors, radians.
    """
    errors: list[float] = []
    stds: list[float] = []
    for truth, found in zip(references, sources, strict=True):
        error_re = angular_errors(truth, [source.azimuth for source in found])
        rows, columns = matching(error_re, tolerance)
        errors.extend(error_re[rows, columns])
        stds.extend(found[column].azimuth_std for column in columns)
    return SpreadErrors(np.array(errors, dtype=np.float64), np.array(stds, dtype=np.float64))


def coverage(spread: SpreadErrors, num_stds: float, scale: float = 1.0) -> float:
    """Share of errors within ``num_stds`` standard deviations, each taken ``scale`` times; NaN without a source."""
    if not len(spread.errors_p):
        return float("nan")
    return float((spread.errors_p <= num_stds * scale * spread.stds_p).mean())


def fit_scale(spread: SpreadErrors) -> float:
    """The factor on the standard deviations with which 68 % of the errors lie within one of them; NaN without a source.

    A quantile, not a root mean square, so that a few wrong matches near the gate do not decide it.
    """
    if not len(spread.errors_p):
        return float("nan")
    return float(np.quantile(spread.errors_p / spread.stds_p, ONE_STD))


def reliability(spread: SpreadErrors, max_bins: int = MAX_BINS) -> tuple[ReliabilityBin, ...]:
    """Predicted against observed spread, over bins with about equally many sources, from sure to unsure.

    Equal predictions are never split, so there may be fewer than ``max_bins``.
    """
    if not len(spread.errors_p):
        return ()
    edges = np.unique(np.quantile(spread.stds_p, np.linspace(0, 1, max_bins + 1)[1:-1]))
    bin_p = np.searchsorted(edges, spread.stds_p, side="left")
    bins = []
    for index in np.unique(bin_p):
        errors, stds = spread.errors_p[bin_p == index], spread.stds_p[bin_p == index]
        bins.append(
            ReliabilityBin(
                low=float(stds.min()),
                high=float(stds.max()),
                predicted=float(np.sqrt(np.mean(stds**2))),
                observed=float(np.sqrt(np.mean(errors**2))),
                within_one=float((errors <= stds).mean()),
                sources=len(errors),
            )
        )
    return tuple(bins)


def calibrate(validation: SpreadErrors, test: SpreadErrors) -> Calibration:
    """Coverage on test scenes, as predicted and after scaling fitted on validation scenes."""
    scale = fit_scale(validation)
    return Calibration(
        sources=len(test.errors_p),
        within_one=coverage(test, 1),
        within_two=coverage(test, 2),
        scale=scale,
        scaled_one=coverage(test, 1, scale),
        scaled_two=coverage(test, 2, scale),
        bins=reliability(test),
    )

import math
from itertools import pairwise

import numpy as np
import pytest

from avssl_pyro.evaluation.spread_calibration import (
    ONE_STD,
    TWO_STD,
    SpreadErrors,
    calibrate,
    coverage,
    fit_scale,
    match_spreads,
    reliability,
)
from avssl_pyro.localization.posterior import LocalizedSource

NOTHING = SpreadErrors(np.empty(0), np.empty(0))


def source(azimuth, std):
    return LocalizedSource(azimuth, std, 0.5, 0.1, 0.4, 0)


def normal_errors(num, truth_over_told=1.0, seed=0):
    """Sources whose errors are normal, with spreads from 1 to 4 degrees that are told too small by a factor."""
    rng = np.random.default_rng(seed)
    stds = np.deg2rad(rng.uniform(1, 4, size=num))
    return SpreadErrors(np.abs(rng.normal(0, truth_over_told * stds)), stds)


def test_only_matched_sources_count_and_each_brings_its_own_spread():
    references = [[0.0, 2.0], [np.pi - 0.01], []]
    sources = [(source(2.02, 0.03), source(0.05, 0.01), source(-2.0, 0.5)), (source(-np.pi + 0.01, 0.04),), ()]
    spread = match_spreads(references, sources, tolerance=0.1)
    pairs = sorted(zip(spread.errors_p.round(6), spread.stds_p, strict=True))
    assert pairs == [(0.02, 0.03), (0.02, 0.04), (0.05, 0.01)]
    assert [coverage(spread, number) for number in (1, 2, 6)] == pytest.approx([2 / 3, 2 / 3, 1])


def test_a_true_spread_covers_as_a_normal_distribution_and_needs_no_scale():
    found = calibrate(normal_errors(4000, seed=1), normal_errors(4000, seed=2))
    assert found.sources == 4000
    assert (found.within_one, found.within_two) == pytest.approx((ONE_STD, TWO_STD), abs=0.03)
    assert found.scale == pytest.approx(1, abs=0.05)
    for part in found.bins:
        assert part.observed == pytest.approx(part.predicted, rel=0.1)
        assert part.within_one == pytest.approx(ONE_STD, abs=0.06)


def test_a_spread_that_is_half_the_truth_is_found_out_and_mended():
    found = calibrate(normal_errors(4000, 2, seed=1), normal_errors(4000, 2, seed=2))
    assert found.within_one == pytest.approx(0.383, abs=0.03)
    assert found.scale == pytest.approx(2, abs=0.1)
    assert (found.scaled_one, found.scaled_two) == pytest.approx((ONE_STD, TWO_STD), abs=0.03)


def test_the_scale_comes_from_validation_scenes_alone():
    found = calibrate(normal_errors(4000, 3, seed=1), normal_errors(4000, 1, seed=2))
    assert found.scale == pytest.approx(3, abs=0.15)
    assert found.scaled_one > 0.99


def test_one_wild_match_does_not_move_the_scale():
    spread = normal_errors(200)
    wild = SpreadErrors(np.append(spread.errors_p, 0.34), np.append(spread.stds_p, 0.01))
    assert fit_scale(wild) == pytest.approx(fit_scale(spread), rel=0.05)


def test_bins_go_from_sure_to_unsure_and_hold_every_source_once():
    spread = normal_errors(1000)
    bins = reliability(spread, 4)
    assert [part.sources for part in bins] == [250] * 4
    assert all(before.high < after.low for before, after in pairwise(bins))
    assert all(part.low <= part.predicted <= part.high for part in bins)


def test_equal_spreads_share_a_bin():
    stds = np.array([0.02] * 90 + [0.1] * 10)
    bins = reliability(SpreadErrors(np.full(100, 0.05), stds))
    assert [(part.low, part.sources, part.within_one) for part in bins] == [(0.02, 90, 0.0), (0.1, 10, 1.0)]


def test_without_a_matched_source_there_is_no_number():
    found = calibrate(NOTHING, NOTHING)
    assert found.sources == 0
    assert found.bins == ()
    assert all(math.isnan(value) for value in (found.within_one, found.within_two, found.scale, found.scaled_one))

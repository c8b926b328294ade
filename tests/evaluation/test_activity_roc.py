import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.evaluation.activity_roc import levels_of, roc_curve
from avssl_pyro.localization.posterior import ClipPosterior

GRID = DirectionGrid()
LEVELS = st.lists(st.sampled_from([0.0, 0.1, 0.2, 0.5, 0.9]), min_size=1, max_size=12)


def posterior(directions, levels):
    """Classes that point at directions of the grid; None points nowhere, as diffuse noise."""
    weights_kd = np.full((len(directions), 72), 1e-4)
    for k, direction in enumerate(directions):
        weights_kd[k, slice(None) if direction is None else direction] = 1.0
    weights_kd /= weights_kd.sum(axis=-1, keepdims=True)
    zeros_k = np.zeros(len(directions))
    return ClipPosterior(weights_kd, np.array(levels), zeros_k, zeros_k)


def test_people_have_the_level_of_the_nearest_class_that_points_somewhere():
    # Direction 27 is at 42.5 degrees, 29 at 32.5, 54 at -92.5 and 0 at 177.5.
    found = posterior([27, 29, 54, None, 0], [0.3, 0.001, 0.2, 0.4, 0.099])
    people = np.deg2rad([41.0, 31.0, -106.0, -109.0, 100.0, -175.0])
    assert levels_of(people, found, GRID) == pytest.approx([0.301, 0.301, 0.2, 0.0, 0.0, 0.099], rel=0.05)


def test_without_people_or_pointed_classes_nothing_breaks():
    assert levels_of([], posterior([27], [1.0]), GRID).shape == (0,)
    assert levels_of([0.0, 1.0], posterior([None], [1.0]), GRID).tolist() == [0.0, 0.0]


def test_levels_that_tell_all_or_nothing():
    assert roc_curve([0.5, 0.4], [0.1, 0.0, 0.3]).area == 1.0
    assert roc_curve([0.1, 0.0], [0.2, 0.4]).area == 0.0
    assert roc_curve([0.2, 0.2], [0.2]).area == 0.5
    assert roc_curve([0.1, 0.3], [0.1, 0.3]).area == 0.5
    # Of six pairs, the talker is louder in four and as loud in one.
    assert roc_curve([0.1, 0.5], [0.0, 0.1, 0.3]).area == pytest.approx(4.5 / 6)


def test_the_curve_passes_through_every_threshold():
    curve = roc_curve([0.5, 0.3], [0.3, 0.1, 0.1, 0.1])
    assert curve.false_alarms_p.tolist() == [0.0, 0.0, 0.25, 1.0]
    assert curve.hits_p.tolist() == [0.0, 0.5, 1.0, 1.0]


@given(LEVELS, LEVELS)
def test_the_area_is_that_below_the_curve(talking, silent):
    curve = roc_curve(talking, silent)
    assert np.trapezoid(curve.hits_p, curve.false_alarms_p) == pytest.approx(curve.area)
    assert roc_curve(silent, talking).area == pytest.approx(1 - curve.area)
    assert (curve.hits_p[[0, -1]].tolist(), curve.false_alarms_p[[0, -1]].tolist()) == ([0, 1], [0, 1])


@pytest.mark.parametrize(("talking", "silent"), [([], [0.1]), ([0.1], []), ([], [])])
def test_one_kind_of_people_alone_has_no_curve(talking, silent):
    assert roc_curve(talking, silent) is None

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import pdist

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.diagnosis.finding import Severity
from avssl_pyro.diagnosis.geometry import (
    aliasing_limit_hz,
    check_geometry,
    exchange_classes,
    is_mirror_blind,
    principal_axes,
)

UPRIGHT = MicrophoneArray("upright", ((0.0, 0.1, 0.0), (0.0, -0.1, 0.0), (0.0, 0.0, 0.1)))
LINE = MicrophoneArray("line", ((0.0, 0.1, 0.0), (0.0, 0.0, 0.0), (0.0, -0.1, 0.0)))


def messages(array: MicrophoneArray) -> str:
    return " | ".join(finding.message for finding in check_geometry(array))


def test_a_line_is_ambiguous_front_to_back() -> None:
    assert "a line along azimuth 90 deg" in messages(LINE)
    assert "front-back ambiguity" in messages(LINE)
    assert is_mirror_blind(LINE) and is_mirror_blind(PRESETS["circle2"])


def test_a_plane_is_ambiguous_up_and_down() -> None:
    assert "up-down ambiguity" in messages(PRESETS["circle6"])
    assert not is_mirror_blind(PRESETS["circle6"])


def test_an_upright_plane_is_worse() -> None:
    assert "upright plane" in messages(UPRIGHT)
    assert is_mirror_blind(UPRIGHT)


def test_limits_are_notes() -> None:
    for array in (PRESETS["circle2"], PRESETS["circle6"], PRESETS["respeaker4"], UPRIGHT, LINE):
        assert max(finding.severity for finding in check_geometry(array)) <= Severity.NOTE


def test_the_aliasing_limit_is_that_of_the_widest_gap() -> None:
    assert aliasing_limit_hz(PRESETS["circle2"]) == pytest.approx(343 / 0.4)
    assert aliasing_limit_hz(PRESETS["circle6"]) == pytest.approx(343 / 0.2)
    assert "1715 Hz" in messages(PRESETS["circle6"])
    assert "35 cm from the camera's axis" in messages(
        MicrophoneArray("aside", ((0.3, 0, 0), (0.4, 0, 0), (0.35, 0.05, 0.0), (0.35, -0.05, 0)))
    )


def test_exchanges_of_regular_arrays() -> None:
    assert exchange_classes(PRESETS["circle2"]) == [[(0, 1)]]
    assert exchange_classes(PRESETS["circle4"]) == [[(0, 2), (1, 3)], [(0, 1), (2, 3)], [(0, 3), (1, 2)]]
    hidden, *heard = exchange_classes(PRESETS["circle6"])
    assert hidden == []
    assert sum(map(len, heard)) == 15


coordinate = st.integers(-20, 20).map(lambda step: step / 100)
places = st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=2, max_size=6, unique=True)


@given(places)
def test_exchange_classes_are_a_partition(positions: list[tuple[float, float, float]]) -> None:
    array = MicrophoneArray("any", tuple(positions))
    classes = exchange_classes(array)
    pairs = [pair for members in classes for pair in members]
    assert sorted(pairs) == list(combinations(range(len(positions)), 2))
    for first, second in classes[0]:
        order = list(range(len(positions)))
        order[first], order[second] = second, first
        np.testing.assert_allclose(pdist(array.positions[order]), pdist(array.positions), atol=1e-3)


@given(st.floats(0, 2 * np.pi), st.floats(0.02, 1.0))
def test_the_dimension_does_not_depend_on_how_the_array_stands(azimuth: float, size: float) -> None:
    along = size * np.array([np.cos(azimuth), np.sin(azimuth), 0.3])
    assert principal_axes(np.stack([0 * along, along, 2.5 * along]))[0] == 1
    assert principal_axes(np.stack([0 * along, along, [0, 0, size]]))[0] == 2

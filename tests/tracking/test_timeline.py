"""What is known between two windows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.tracking.timeline import IdentifiedSource, Timeline, TimelineFrame


def source(name: int, azimuth_deg: float, level: float = 0.3) -> IdentifiedSource:
    return IdentifiedSource(name, float(np.deg2rad(azimuth_deg)), 0.05, level)


def timeline(*moments: tuple[IdentifiedSource, ...]) -> Timeline:
    return Timeline(tuple(TimelineFrame(0.5 + 0.1 * index, sources) for index, sources in enumerate(moments)), 0.1, 0.5)


def test_a_source_moves_evenly_along_the_shorter_arc() -> None:
    line = timeline((source(1, 176, 0.2),), (source(1, -176, 0.4),))
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        (found,) = line.at(0.5 + 0.1 * share)
        offset = np.rad2deg(wrap_angle(found.azimuth - np.deg2rad(176)))
        assert offset == pytest.approx(8 * share, abs=1e-6)
        assert found.level == pytest.approx(0.2 + 0.2 * share, abs=1e-6)


def test_a_jump_is_no_walk() -> None:
    line = timeline((source(1, 0),), (source(1, 90),))
    assert line.at(0.549)[0].azimuth == 0
    assert line.at(0.551)[0].azimuth == pytest.approx(np.pi / 2)


def test_who_is_in_one_window_only_lasts_half_way_to_the_next() -> None:
    line = timeline((source(1, 0),), (source(1, 0), source(2, 90)), (source(1, 0),))
    assert [s.name for s in line.at(0.549)] == [1]
    assert [s.name for s in line.at(0.551)] == [1, 2]
    assert [s.name for s in line.at(0.649)] == [1, 2]
    assert [s.name for s in line.at(0.651)] == [1]


def test_the_first_and_the_last_window_reach_their_own_ends_and_no_further() -> None:
    line = timeline((source(1, 0),), (source(2, 0),))
    assert [s.name for s in line.at(0.0)] == [1]
    assert [s.name for s in line.at(1.1)] == [2]
    assert line.at(-0.01) == line.at(1.11) == ()
    assert Timeline((), 0.1, 0.5).at(0.3) == ()


def test_a_gap_is_not_filled() -> None:
    line = Timeline((TimelineFrame(0.5, (source(1, 0),)), TimelineFrame(5.0, (source(1, 20),))), 0.1, 0.5)
    assert line.at(1.0)[0].azimuth == 0
    assert line.at(2.75) == ()
    assert line.at(4.5)[0].azimuth == pytest.approx(np.deg2rad(20))


@given(st.floats(-180, 180), st.floats(-25, 25), st.floats(0, 1))
def test_turning_everything_turns_what_lies_between(start_deg: float, turn_deg: float, share: float) -> None:
    here = timeline((source(1, 0),), (source(1, turn_deg),)).at(0.5 + 0.1 * share)[0]
    there = timeline((source(1, start_deg),), (source(1, start_deg + turn_deg),)).at(0.5 + 0.1 * share)[0]
    assert wrap_angle(there.azimuth - here.azimuth - np.deg2rad(start_deg)) == pytest.approx(0, abs=1e-9)

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle

angles = st.floats(-1e3, 1e3)


def test_image_edges_and_quarters() -> None:
    grid = DirectionGrid(288)
    azimuths_deg = np.rad2deg(grid.azimuths)
    # Columns 71 and 72 meet at the left quarter, 143 and 144 in the centre, 215 and 216 at the right quarter.
    for left, expected in ((71, 90.0), (143, 0.0), (215, -90.0)):
        assert azimuths_deg[left : left + 2].mean() == pytest.approx(expected)
    assert azimuths_deg[0] == pytest.approx(180 - 0.625)
    assert azimuths_deg[-1] == pytest.approx(-180 + 0.625)


@pytest.mark.parametrize("num_directions", [1, 36, 72, 288])
def test_nearest_inverts_azimuths(num_directions: int) -> None:
    grid = DirectionGrid(num_directions)
    assert grid.nearest(grid.azimuths).tolist() == list(range(num_directions))


@given(angles, st.integers(1, 400), st.integers(-3, 3))
def test_nearest_is_the_block_that_holds_the_azimuth(azimuth: float, num_directions: int, turns: int) -> None:
    grid = DirectionGrid(num_directions)
    index = int(grid.nearest(azimuth))
    assert 0 <= index < num_directions
    assert abs(wrap_angle(azimuth - grid.azimuths[index])) <= grid.spacing / 2 + 1e-9
    # Away from the edges of a block, whole turns change nothing.
    if abs(wrap_angle(azimuth - grid.azimuths[index])) < grid.spacing / 2 - 1e-9:
        assert int(grid.nearest(azimuth + 2 * np.pi * turns)) == index


@given(st.integers(0, 71), st.integers(-200, 200))
def test_turning_by_whole_blocks_turns_the_index(index: int, blocks: int) -> None:
    grid = DirectionGrid(72)
    # Counter-clockwise is to the left, towards smaller indices.
    assert int(grid.nearest(grid.azimuths[index] + blocks * grid.spacing)) == (index - blocks) % 72


@given(angles)
def test_wrapped_angles_are_the_same_direction_within_one_turn(angle: float) -> None:
    wrapped = float(wrap_angle(angle))
    assert -np.pi <= wrapped <= np.pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * angle), abs=1e-9)


def test_unit_vectors_point_along_the_axes() -> None:
    vectors = DirectionGrid(72).unit_vectors
    assert np.linalg.norm(vectors, axis=-1) == pytest.approx(np.ones(72))
    ahead, left = DirectionGrid(4).nearest([0.01, np.pi / 2 + 0.01])
    coarse = DirectionGrid(4).unit_vectors
    assert coarse[ahead] @ [1, 1, 0] == pytest.approx(np.sqrt(2))
    assert coarse[left] @ [-1, 1, 0] == pytest.approx(np.sqrt(2))

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avssl_pyro.simulation.compositing import PersonPosition, composite, relight

AZIMUTH_J = np.pi - (np.arange(288) + 0.5) / 288 * 2 * np.pi
ELEVATION_I = np.deg2rad(55 - (np.arange(88) + 0.5) * 1.25)
PIXEL = np.deg2rad(1.25)
GRAY = np.full((88, 288, 3), 100, dtype=np.uint8)


def board(color: tuple[int, int, int] = (255, 0, 0), rows: int = 200, columns: int = 60) -> np.ndarray:
    cutout_ijc = np.zeros((rows, columns, 4), dtype=np.uint8)
    cutout_ijc[:] = (*color, 255)
    return cutout_ijc


@given(st.floats(-3.14, 3.14), st.floats(0.5, 2.0), st.floats(1.5, 1.9), st.floats(1.2, 1.5))
@settings(max_examples=40, deadline=None)
def test_a_board_covers_exactly_the_rays_that_meet_it(
    azimuth: float, distance_m: float, height_m: float, camera_m: float
) -> None:
    visible_ij = composite(GRAY, [board()], [PersonPosition(azimuth, distance_m, height_m)], camera_m).visible_pij[0]
    normal = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    left = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    rays_ijx = np.stack(
        [
            np.cos(ELEVATION_I)[:, None] * np.cos(AZIMUTH_J),
            np.cos(ELEVATION_I)[:, None] * np.sin(AZIMUTH_J),
            np.broadcast_to(np.sin(ELEVATION_I)[:, None], (88, 288)),
        ],
        axis=-1,
    )
    facing_ij = rays_ijx @ normal
    point_ijx = rays_ijx * (distance_m / np.where(facing_ij > 1e-3, facing_ij, np.nan))[..., None]
    half_width = height_m * 60 / 200 / 2
    # How far inside the board's outline a ray lands (negative outside), in metres.
    with np.errstate(invalid="ignore"):
        inside_ij = np.minimum(
            half_width - np.abs(point_ijx @ left),
            np.minimum(point_ijx[..., 2] + camera_m, height_m - camera_m - point_ijx[..., 2]),
        )
    inside_ij = np.nan_to_num(inside_ij, nan=-9.0)
    # A pixel covers at most this much of the board near its lower end, seen at 55 degrees.
    margin = PIXEL * distance_m * 4
    assert (visible_ij[inside_ij > margin] > 0.99).all()
    assert (visible_ij[inside_ij < -margin] < 0.01).all()


def test_left_is_left_and_feet_are_on_the_floor() -> None:
    at_left = composite(GRAY, [board()], [PersonPosition(np.pi / 2, 1.5, 1.7)], 1.35)
    rows, columns = np.nonzero(at_left.visible_pij[0] > 0.5)
    assert columns.mean() == pytest.approx(71.5, abs=0.6)
    assert columns.max() < 144
    assert ELEVATION_I[rows.max()] == pytest.approx(-np.arctan2(1.35, 1.5), abs=PIXEL)
    assert ELEVATION_I[rows.min()] == pytest.approx(np.arctan2(1.7 - 1.35, 1.5), abs=PIXEL)
    assert (at_left.image_ijc[45, 71] == (255, 0, 0)).all()


def test_a_person_is_not_mirrored() -> None:
    cutout_ijc = board()
    cutout_ijc[:, :30, :3] = (0, 255, 0)
    image_ijc = composite(GRAY, [cutout_ijc], [PersonPosition(0.0, 1.0, 1.7)], 1.35).image_ijc
    assert (image_ijc[44, 140] == (0, 255, 0)).all()
    assert (image_ijc[44, 147] == (255, 0, 0)).all()


def test_the_head_stands_at_the_azimuth_even_if_the_body_leans() -> None:
    cutout_ijc = board(columns=100)
    cutout_ijc[:40, :70, 3] = 0  # the head is the right third
    visible_ij = composite(GRAY, [cutout_ijc], [PersonPosition(0.0, 1.0, 1.7)], 1.35).visible_pij[0]
    top = np.nonzero(visible_ij.max(axis=1) > 0.5)[0][0]
    assert np.average(np.arange(288), weights=visible_ij[top + 1]) == pytest.approx(143.5, abs=0.6)


def test_someone_behind_the_camera_wraps_at_the_seam() -> None:
    across = composite(GRAY, [board()], [PersonPosition(np.pi, 0.8, 1.7)], 1.35).visible_pij[0].max(axis=0)
    ahead = composite(GRAY, [board()], [PersonPosition(0.0, 0.8, 1.7)], 1.35).visible_pij[0].max(axis=0)
    assert across[0] > 0.99 and across[-1] > 0.99 and across[144] == 0
    np.testing.assert_allclose(np.roll(across, 144), ahead, atol=1e-4)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_nearer_one_hides_the_farther_one(order: tuple[int, int]) -> None:
    people = [(board((255, 0, 0)), PersonPosition(0.0, 0.7, 1.8)), (board((0, 0, 255)), PersonPosition(0.05, 1.8, 1.6))]
    shuffled = [people[index] for index in order]
    result = composite(GRAY, [cutout for cutout, _ in shuffled], [place for _, place in shuffled], 1.35)
    near, far = order.index(0), order.index(1)
    assert (result.image_ijc[50, 143] == (255, 0, 0)).all()
    assert result.visible_pij[far, 50, 143] == 0
    assert result.visible_pij[near, 50, 143] > 0.99
    assert result.visible_pij.sum(axis=0).max() < 1.001


def test_nobody_changes_nothing_and_light_spares_alpha() -> None:
    noise_ijc = np.random.default_rng(0).integers(0, 256, (88, 288, 3), dtype=np.uint8)
    np.testing.assert_array_equal(composite(noise_ijc, [], [], 1.35).image_ijc, noise_ijc)
    np.testing.assert_array_equal(relight(noise_ijc, np.random.default_rng(1), strength=0.0), noise_ijc)
    cutout_ijc = np.random.default_rng(2).integers(0, 256, (20, 10, 4), dtype=np.uint8)
    lit_ijc = relight(cutout_ijc, np.random.default_rng(3))
    np.testing.assert_array_equal(lit_ijc[..., 3], cutout_ijc[..., 3])
    assert not np.array_equal(lit_ijc[..., :3], cutout_ijc[..., :3])

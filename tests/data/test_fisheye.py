import numpy as np

from avssl_pyro.data.fisheye import is_double_fisheye


def test_two_lit_circles_on_black_are_fisheyes_and_a_room_with_black_poles_is_not() -> None:
    rng = np.random.default_rng(0)
    room_ijc = rng.integers(60, 200, (240, 480, 3)).astype(np.uint8)
    assert not is_double_fisheye(room_ijc)
    poles_ijc = room_ijc.copy()
    poles_ijc[:60], poles_ijc[-60:] = 0, 0
    assert not is_double_fisheye(poles_ijc)
    assert not is_double_fisheye(np.zeros_like(room_ijc))
    y, x = np.mgrid[-1:1:240j, -1:1:240j]
    circle_ij = x**2 + y**2 < 1
    assert is_double_fisheye(
        np.where(np.tile(circle_ij, 2)[..., None], room_ijc, rng.integers(0, 9, (240, 480, 3))).astype(np.uint8)
    )

import numpy as np
import pytest

from avssl_pyro.errors import InputError
from avssl_pyro.io.projection_check import check_equirectangular, count_fisheyes

RNG = np.random.default_rng(0)
ROOM = RNG.integers(60, 200, (240, 480, 3)).astype(np.uint8)
Y, X = np.mgrid[-1:1:240j, -1:1:240j]
CIRCLE = X**2 + Y**2 < 1


def on_black(lit_ij: np.ndarray) -> np.ndarray:
    return np.where(lit_ij[..., None], ROOM, RNG.integers(0, 9, ROOM.shape)).astype(np.uint8)


def test_a_room_a_dark_one_and_one_with_black_poles_are_no_fisheyes() -> None:
    poles_ijc = ROOM.copy()
    poles_ijc[:60], poles_ijc[-60:] = 0, 0
    window_ijc = np.zeros_like(ROOM)
    window_ijc[100:140, 200:260] = 255
    for frame_ijc in (ROOM, poles_ijc, window_ijc, np.zeros_like(ROOM)):
        assert count_fisheyes(frame_ijc) == 0
        check_equirectangular(frame_ijc, "room.png")


@pytest.mark.parametrize(
    ("lit_ij", "number", "says"),
    [
        (np.tile(CIRCLE, 2), 2, "two fisheye pictures side by side"),
        (np.pad(CIRCLE, ((0, 0), (120, 120))), 1, "one fisheye picture on black"),
    ],
)
def test_lit_circles_on_black_are_fisheyes(lit_ij: np.ndarray, number: int, says: str) -> None:
    assert count_fisheyes(on_black(lit_ij)) == number
    with pytest.raises(InputError, match=f"walk.mp4: {says}; export it as equirectangular"):
        check_equirectangular(on_black(lit_ij), "walk.mp4")

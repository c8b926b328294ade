"""Detection of fisheye images, as 360-degree cameras store them, among equirectangular ones."""

import numpy as np
import numpy.typing as npt

from avssl_pyro.errors import InputError

# Of 255, after any codec: black, and surely lit.
_DARK, _LIT = 24, 48
_PHRASES = {1: "one fisheye picture on black", 2: "two fisheye pictures side by side"}


def check_equirectangular(frame_ijc: npt.NDArray[np.uint8], where: str) -> None:
    """Refuses fisheye pictures.

    Raises:
        InputError: the picture shows one or two of them, see :func:`count_fisheyes`.
    """
    number = count_fisheyes(frame_ijc)
    if number:
        raise InputError(f"{where}: {_PHRASES[number]}; export it as equirectangular with the camera's own program.")


def count_fisheyes(frame_ijc: npt.NDArray[np.uint8]) -> int:
    """How many fisheye pictures there are: two side by side, one in the middle, or none (0).

    Everything outside their circles is black, but not the circles. Looked at are only the rows around the horizon,
    since equirectangular pictures may be black above and below.

    Args:
        frame_ijc: uint8, (H, W, 3), twice as wide as high.
    """
    rows, columns = frame_ijc.shape[:2]
    y_i1 = (2 * np.arange(rows)[:, None] + 1) / rows - 1
    x_1j = (4 * np.arange(columns)[None] + 2) / columns - 2
    for number, across_1j in ((2, np.abs(x_1j) - 1), (1, x_1j)):
        radius_ij = np.hypot(y_i1, across_1j)
        horizon_i1 = np.abs(y_i1) < 0.7
        outside, inside = frame_ijc[horizon_i1 & (radius_ij > 1.05)], frame_ijc[horizon_i1 & (radius_ij < 0.8)]
        if np.percentile(outside, 99) < _DARK and inside.mean() > _LIT:
            return number
    return 0

"""Telling two fisheye pictures side by side, as 360-degree cameras store them, from an equirectangular one."""

import numpy as np
import numpy.typing as npt

# Of 255, after any codec: black, and surely lit.
_DARK, _LIT = 24, 48


def is_double_fisheye(frame_ijc: npt.NDArray[np.uint8]) -> bool:
    """Whether everything outside two circles side by side is black, but not the circles.

    Looked at are only the rows around the horizon, since equirectangular pictures may be black above and below.

    Args:
        frame_ijc: uint8, (H, W, 3), twice as wide as high.
    """
    rows, columns = frame_ijc.shape[:2]
    y_i1 = (2 * np.arange(rows)[:, None] + 1) / rows - 1
    x_1j = (4 * np.arange(columns)[None] + 2) / columns % 2 - 1
    radius_ij = np.hypot(y_i1, x_1j)
    horizon_i1 = np.abs(y_i1) < 0.7
    outside, inside = frame_ijc[horizon_i1 & (radius_ij > 1.05)], frame_ijc[horizon_i1 & (radius_ij < 0.8)]
    return bool(np.percentile(outside, 99) < _DARK and inside.mean() > _LIT)

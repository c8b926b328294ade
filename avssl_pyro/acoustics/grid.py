"""Grid of horizontal candidate directions, aligned with the columns of an equirectangular image."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


def wrap_angle(angle: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Wraps angles in radians to [-pi, pi)."""
    wrapped: npt.NDArray[np.float64] = (np.asarray(angle, dtype=np.float64) + np.pi) % (2 * np.pi) - np.pi
    return wrapped


@dataclass(frozen=True)
class DirectionGrid:
    """D horizontal directions; direction d is the middle of the d-th block of image columns from the left.

    Direction d has azimuth ``180 - 360 (d + 0.5) / D`` degrees, counter-clockwise from straight ahead. The left edge of
    the image is thus +180 degrees, and the middle of its left half +90 degrees.

    Args:
        num_directions: number D of directions.

    >>> np.rad2deg(DirectionGrid(4).azimuths).round().tolist()
    [135.0, 45.0, -45.0, -135.0]
    """

    num_directions: int = 72

    @property
    def azimuths(self) -> npt.NDArray[np.float64]:
        """Azimuths of the directions, (D,), radians, decreasing from left to right."""
        index_d = np.arange(self.num_directions)
        return np.pi - 2 * np.pi * (index_d + 0.5) / self.num_directions

    @property
    def spacing(self) -> float:
        """Angle between neighbouring directions, radians."""
        return 2 * np.pi / self.num_directions

    @property
    def unit_vectors(self) -> npt.NDArray[np.float64]:
        """Unit vectors of the directions, (D, 3)."""
        azimuths_d = self.azimuths
        return np.stack([np.cos(azimuths_d), np.sin(azimuths_d), np.zeros_like(azimuths_d)], axis=-1)

    def nearest(self, azimuth: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Returns the index of the direction nearest to each azimuth (radians)."""
        turned = (np.pi - np.asarray(azimuth, dtype=np.float64)) % (2 * np.pi)
        return np.floor(turned / self.spacing).astype(np.int64) % self.num_directions

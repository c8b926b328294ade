"""The horizontal grid of candidate directions, tied to the columns of an equirectangular image."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


def wrap_angle(angle: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Angles in radians, wrapped to [-pi, pi)."""
    wrapped: npt.NDArray[np.float64] = (np.asarray(angle, dtype=np.float64) + np.pi) % (2 * np.pi) - np.pi
    return wrapped


@dataclass(frozen=True)
class DirectionGrid:
    """D directions on the horizontal plane; direction d is the d-th block of image columns from the left.

    Direction d has azimuth ``180 - 360 (d + 0.5) / D`` degrees, counter-clockwise from straight ahead, so the left edge
    of the image is +180 and the left quarter +90.

    >>> np.rad2deg(DirectionGrid(4).azimuths).round().tolist()
    [135.0, 45.0, -45.0, -135.0]
    """

    num_directions: int = 72

    @property
    def azimuths(self) -> npt.NDArray[np.float64]:
        """Azimuth of every direction, (D,), radians, falling from left to right."""
        index_d = np.arange(self.num_directions)
        return np.pi - 2 * np.pi * (index_d + 0.5) / self.num_directions

    @property
    def spacing(self) -> float:
        """Angle between neighbours, radians."""
        return 2 * np.pi / self.num_directions

    @property
    def unit_vectors(self) -> npt.NDArray[np.float64]:
        """Unit vectors towards the directions, (D, 3)."""
        azimuths_d = self.azimuths
        return np.stack([np.cos(azimuths_d), np.sin(azimuths_d), np.zeros_like(azimuths_d)], axis=-1)

    def nearest(self, azimuth: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Index of the block that contains each azimuth (radians)."""
        turned = (np.pi - np.asarray(azimuth, dtype=np.float64)) % (2 * np.pi)
        return np.floor(turned / self.spacing).astype(np.int64) % self.num_directions

"""What a window's detections say about a source: found or missed, blurred, among clutter."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle


@dataclass(frozen=True)
class DetectionModel:
    """A sounding source is detected at most once a window; false detections are Poisson, uniform over azimuth.

    The likelihood ratio of a window is that of probabilistic data association with an uncertain source (Musicki, Evans,
    Stankovic 1994, "Integrated probabilistic data association").

    Args:
        found: probability that a sounding source is detected in a window.
        clutter: mean number of false detections in a window.
        least_std: least error of an azimuth, radians; a localizer's own standard deviation says how sharp a peak is,
            not how far reverberation moved it.
    """

    found: float = 0.88
    clutter: float = 0.1
    least_std: float = float(np.deg2rad(3.0))

    @property
    def clutter_density(self) -> float:
        """Mean number of false detections in a window and radian."""
        return self.clutter / (2 * np.pi)

    def density(
        self, grid: DirectionGrid, azimuth_n: npt.NDArray[np.float64], std_n: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]:
        """Density of each azimuth given a source somewhere in the cell of direction d, (N, D), per radian."""
        variance_n1 = (np.maximum(std_n, self.least_std) ** 2 + grid.spacing**2 / 12)[:, None]
        error_nd = wrap_angle(azimuth_n[:, None] - grid.azimuths)
        turned_vnd = error_nd + 2 * np.pi * np.array([-1.0, 0.0, 1.0])[:, None, None]
        density_nd: npt.NDArray[np.float64] = np.exp(-0.5 * turned_vnd**2 / variance_n1).sum(0)
        return density_nd / np.sqrt(2 * np.pi * variance_n1)

    def ratio_terms(
        self, density_nd: npt.NDArray[np.float64], others_n: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]:
        """Each detection's part of the likelihood ratio of a window, (N, D); their sum and :attr:`missed` make it up.

        Args:
            density_nd: from :meth:`density`.
            others_n: density of detections due to other sources at each azimuth, (N,), per radian; it adds to that of
                clutter (Musicki, La Scala 2008, "Multi-target tracking in clutter without measurement assignment").
        """
        terms_nd: npt.NDArray[np.float64] = self.found * density_nd / (self.clutter_density + others_n)[:, None]
        return terms_nd

    @property
    def missed(self) -> float:
        """The likelihood ratio of a window without any detection."""
        return 1 - self.found

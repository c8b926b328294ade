"""What a window's detections say about a source: found or missed, blurred, among clutter."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class DetectionModel:
    """A sounding source is detected at most once a window; false detections are Poisson, uniform over azimuth.

    The likelihood ratio of a window is that of probabilistic data association with an uncertain source (Musicki, Evans,
    Stankovic 1994, "Integrated probabilistic data association"), where other sources claim detections as well.

    Raises:
        InputError: a probability, rate or spread that leaves nothing to infer.

    Args:
        found: probability that a sounding source is detected in a window.
        clutter: mean number of false detections in a window.
        least_std: least error of an azimuth, radians; a localizer's own standard deviation says how sharp a peak is,
            not how far reverberation moved it.
    """

    found: float = 0.88
    clutter: float = 0.1
    least_std: float = float(np.deg2rad(3.0))

    def __post_init__(self) -> None:
        if not (0 < self.found < 1 and self.clutter > 0 and self.least_std > 0):
            raise InputError(
                f"detections found with probability {self.found}, {self.clutter} false ones a window, errors of "
                f"at least {self.least_std} rad: the first must be between 0 and 1, the others positive."
            )

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

    def claims(self, expected_n: npt.NDArray[np.float64], sounding: float) -> npt.NDArray[np.float64]:
        """How strongly a source claims each detection, (N,), per radian; its claim over the density of clutter is the
        odds that it caused the detection, rather than another one or none.

        With one other source, treating its claim as clutter is exact; with more, their claims are added up. A source
        that is surely there claims a lone detection several times as strongly as it expects it: were the detection not
        its own, it would have been missed. So no second source settles on the detections of a first.

        Args:
            expected_n: density of its detections expected at each azimuth, (N,), per radian.
            sounding: probability that it sounds.
        """
        elsewhere_n = (expected_n.sum() - expected_n) / self.clutter_density
        claims_n: npt.NDArray[np.float64] = expected_n / (1 - self.found * sounding + elsewhere_n)
        return claims_n

    def ratio_terms(
        self, density_nd: npt.NDArray[np.float64], claimed_n: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]:
        """Each detection's part of the likelihood ratio of a window, (N, D); their sum and :attr:`missed` make it up.

        Args:
            density_nd: from :meth:`density`.
            claimed_n: sum of the other sources' claims, (N,), per radian; they add to the density of clutter.
        """
        terms_nd: npt.NDArray[np.float64] = self.found * density_nd / (self.clutter_density + claimed_n)[:, None]
        return terms_nd

    @property
    def missed(self) -> float:
        """The likelihood ratio of a window without any detection."""
        return 1 - self.found

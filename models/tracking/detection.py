"""Likelihood of a window's detections given a source: errors, misses and clutter."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class DetectionModel:
    """Model of at most one detection per source and window, with Poisson clutter.

    Clutter is uniform over azimuth. The likelihood ratio of a window follows integrated probabilistic data association
    (Musicki, Evans, Stankovic 1994), extended by the claims of other sources on the same detections.

    Raises:
        InputError: ``found`` is not between 0 and 1, or ``clutter`` or ``least_std`` is not positive.

    Args:
        found: probability that a sounding source is detected in a window.
        clutter: mean number of false detections in a window.
        least_std: least standard deviation of an azimuth in radians; the localizer's posterior does not include
            errors by reverberation.
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
        """Mean number of false detections per window and radian."""
        return self.clutter / (2 * np.pi)

    def density(
        self, grid: DirectionGrid, azimuth_n: npt.NDArray[np.float64], std_n: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]:
        """Returns densities of azimuths given a source at d, (N, D), per radian.

        The source is uniform over the cell of the direction.

        Args:
            grid: directions d.
            azimuth_n: azimuths in radians, (N,).
            std_n: standard deviations of the azimuths in radians, (N,).
        """
        variance_n1 = (np.maximum(std_n, self.least_std) ** 2 + grid.spacing**2 / 12)[:, None]
        error_nd = wrap_angle(azimuth_n[:, None] - grid.azimuths)
        turned_vnd = error_nd + 2 * np.pi * np.array([-1.0, 0.0, 1.0])[:, None, None]
        density_nd: npt.NDArray[np.float64] = np.exp(-0.5 * turned_vnd**2 / variance_n1).sum(0)
        return density_nd / np.sqrt(2 * np.pi * variance_n1)

    def claims(self, expected_n: npt.NDArray[np.float64], sounding: float) -> npt.NDArray[np.float64]:
        """Returns the claims of a source on the detections, (N,), per radian.

        A claim divided by the density of clutter is the odds that the source caused the detection, against another
        detection or none. With one other source, treating its claim as clutter is exact; with more, the claims are
        summed. The claim of a certain source on a lone detection exceeds the expected density several times, because
        otherwise the source would be missed. This prevents a second source on the detections of the first.

        Args:
            expected_n: density of the source's detections at each azimuth, (N,), per radian.
            sounding: probability that the source sounds.
        """
        elsewhere_n = (expected_n.sum() - expected_n) / self.clutter_density
        claims_n: npt.NDArray[np.float64] = expected_n / (1 - self.found * sounding + elsewhere_n)
        return claims_n

    def ratio_terms(
        self, density_nd: npt.NDArray[np.float64], claimed_n: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]:
        """Returns the terms of a window's likelihood ratio, (N, D), one per detection.

        The likelihood ratio is their sum over detections plus :attr:`missed`.

        Args:
            density_nd: result of :meth:`density`, (N, D), per radian.
            claimed_n: sum of the other sources' claims, (N,), per radian, added to the density of clutter.
        """
        terms_nd: npt.NDArray[np.float64] = self.found * density_nd / (self.clutter_density + claimed_n)[:, None]
        return terms_nd

    @property
    def missed(self) -> float:
        """Likelihood ratio of a window without detections."""
        return 1 - self.found

"""Sources by the level of their direct sound: one rule for all arrays, guides and starts."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.errors import InputError
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource, merge_close, peak_azimuth
from avssl_pyro.validators import Requirement, within

# A neighbour of the peak is at most this part of it.
BELOW = 1 - 1e-9
# A flat class has a level of 0 but for rounding.
ROUNDING = 1e-12


@dataclass(frozen=True)
class DirectLevelRule:
    """Conditions under which a class is a source: the level of its direct sound.

    Of a class with mixing level pi_k and the share e_k of diffuse sound, let W_k be the share of its direction weights
    in ``cells`` cells of D about the peak. Its concentration and its direct level are

        c_k = W_k - cells / (D - cells) (1 - W_k),    s_k = pi_k (1 - e_k) c_k^2.

    A class alike in all directions has c_k = 0. The concentration is squared because a field from many sides, though
    not from all alike, has a moderate one at a high level; a quiet source has a high one at a low level.

    Args:
        least: least direct level of a source, close ones taken together; chosen on simulated talkers and noise.
        cells: odd number of neighbouring directions that a source covers.
        merge_deg: angle in degrees; classes closer than this are one source.

    >>> DirectLevelRule(least=0.01)
    DirectLevelRule(least=0.01, cells=5, merge_deg=12.0)
    """

    least: float = 0.007
    cells: int = 5
    merge_deg: float = 12.0

    def __post_init__(self) -> None:
        within(0, 1).check(self, "least")
        Requirement(lambda cells: cells >= 3 and cells % 2 == 1, "odd and at least 3").check(self, "cells")
        within(0, 180).check(self, "merge_deg")

    def direct_levels(self, posterior: ClipPosterior) -> npt.NDArray[np.float64]:
        """s_k of every class, (K,), at most its mixing level.

        Raises:
            InputError: there are not more directions than cells.
        """
        weights_kd = posterior.direction_weights_kd
        if weights_kd.shape[-1] <= self.cells:
            raise InputError(f"DirectLevelRule: {weights_kd.shape[-1]} directions; more than {self.cells} are needed.")
        around_k = np.take_along_axis(_window_sums(weights_kd, self.cells), _peaks(weights_kd)[:, None], -1)[:, 0]
        others = self.cells / (weights_kd.shape[-1] - self.cells)
        concentration_k = (around_k - others * (1 - around_k)).clip(min=0)
        level_k: npt.NDArray[np.float64] = (
            posterior.mixing_levels_k * (1 - posterior.diffuse_share_k) * concentration_k**2
        )
        return level_k

    def select(self, posterior: ClipPosterior, grid: DirectionGrid) -> tuple[LocalizedSource, ...]:
        """The sources of a clip, loudest direct sound first.

        Close classes are merged first and their levels added.
        """
        peak_k = _peaks(posterior.direction_weights_kd)
        classes = [
            LocalizedSource(
                azimuth=_azimuth(weights_d, int(peak_k[k]), grid),
                azimuth_std=float(posterior.azimuth_std_k[k]),
                level=float(posterior.mixing_levels_k[k]),
                level_std=float(posterior.level_std_k[k]),
                direct_level=float(level),
                source_class=k,
            )
            for k, (weights_d, level) in enumerate(
                zip(posterior.direction_weights_kd, self.direct_levels(posterior), strict=True)
            )
            # Classes without any direct sound have no direction to be merged at.
            if level > max(self.least / len(peak_k), ROUNDING)
        ]
        return tuple(source for source in merge_close(classes, self.merge_deg) if source.direct_level >= self.least)


# One forward pass gives expectations of levels before the clip has decided: quiet classes have higher ones.
ONE_PASS_RULE = DirectLevelRule(least=0.035)


def _azimuth(weights_d: npt.NDArray[np.float64], peak: int, grid: DirectionGrid) -> float:
    """Azimuth of the strongest of three neighbours about the peak, radians."""
    middle = (peak + np.array([-1, 0, 1])) % len(weights_d)
    strongest = int(middle[weights_d[middle].argmax()])
    near = (strongest + np.array([-1, 0, 1])) % len(weights_d)
    alone_d = np.zeros_like(weights_d)
    # Next to the three there may be a higher cell, which is not the peak.
    alone_d[near] = weights_d[near].clip(max=weights_d[strongest] * BELOW)
    alone_d[strongest] = weights_d[strongest]
    return peak_azimuth(alone_d, grid)


def _peaks(weights_kd: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Middle of the strongest three neighbours, (K,)."""
    return _window_sums(weights_kd, 3).argmax(-1)


def _window_sums(weights_kd: npt.NDArray[np.float64], cells: int) -> npt.NDArray[np.float64]:
    """Sums over ``cells`` neighbours about each direction, around the circle, (K, D)."""
    half = cells // 2
    total_kd: npt.NDArray[np.float64] = sum(
        (np.roll(weights_kd, shift, axis=-1) for shift in range(-half, half + 1)), np.zeros_like(weights_kd)
    )
    return total_kd

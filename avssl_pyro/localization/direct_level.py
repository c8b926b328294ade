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


@dataclass(frozen=True)
class DirectLevelRule:
    """Conditions under which a class is a source: the level of its direct sound.

    With W the share of a class's weights, diffuse ones included, in ``cells`` cells of D about its peak, and W_dir that
    of all directions,

        s_k = pi_k (W - cells / (D - cells) (W_dir - W)),

    so that a class alike in all directions scores 0, and so does a wholly diffuse one.

    Args:
        least: least direct level of a source, close ones taken together.
        cells: odd number of neighbouring directions that a source covers.
        merge_deg: angle in degrees; classes closer than this are one source.

    >>> DirectLevelRule(least=0.02)
    DirectLevelRule(least=0.02, cells=5, merge_deg=12.0)
    """

    least: float = 0.03
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
        directional_k = 1.0 if posterior.diffuse_share_k is None else 1 - posterior.diffuse_share_k
        level_k: npt.NDArray[np.float64] = (
            posterior.mixing_levels_k * directional_k * (around_k - others * (1 - around_k))
        )
        return level_k

    def select(self, posterior: ClipPosterior, grid: DirectionGrid) -> tuple[LocalizedSource, ...]:
        """The sources of a clip, loudest first; their level is the direct level.

        Close classes are merged first and their levels added.
        """
        peak_k = _peaks(posterior.direction_weights_kd)
        classes = [
            LocalizedSource(
                azimuth=_azimuth(weights_d, int(peak_k[k]), grid),
                azimuth_std=float(posterior.azimuth_std_k[k]),
                level=float(level),
                level_std=float(posterior.level_std_k[k] * level / posterior.mixing_levels_k[k]),
                source_class=k,
            )
            for k, (weights_d, level) in enumerate(
                zip(posterior.direction_weights_kd, self.direct_levels(posterior), strict=True)
            )
            # Classes without any direct sound have no direction to be merged at.
            if level > self.least / len(peak_k)
        ]
        return tuple(source for source in merge_close(classes, self.merge_deg) if source.level >= self.least)


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

"""The posterior of one clip, and the sources selected from it."""

import math
import sys
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle


@dataclass(frozen=True)
class ClipPosterior:
    """Posterior means and spreads of one clip.

    Args:
        direction_weights_kd: expected direction weights, (K, D), each row summing to 1 (Eq. 1).
        mixing_levels_k: expected mixing levels, (K,), summing to 1.
        level_std_k: their posterior standard deviations, (K,).
        azimuth_std_k: posterior standard deviation of every class's peak direction, (K,), radians.
        activations_kij: 2-D activation maps over the image, (K, I', J'), or None without an image.
        diffuse_shares_kc: shares of diffuse components in all weights of a class, (K, C), which the rows of
            ``direction_weights_kd`` leave out; None where the model has no room.

    >>> weights_kd = np.full((2, 72), 1 / 72)
    >>> ClipPosterior(weights_kd, np.array([0.6, 0.4]), np.full(2, 0.01), np.full(2, 0.02)).mixing_levels_k.sum()
    np.float64(1.0)
    """

    direction_weights_kd: npt.NDArray[np.float64]
    mixing_levels_k: npt.NDArray[np.float64]
    level_std_k: npt.NDArray[np.float64]
    azimuth_std_k: npt.NDArray[np.float64]
    activations_kij: npt.NDArray[np.float32] | None = None
    diffuse_shares_kc: npt.NDArray[np.float64] | None = None

    @property
    def diffuse_share_k(self) -> npt.NDArray[np.float64]:
        """Share of all diffuse components in the weights of every class, (K,); 0 where the model has no room."""
        if self.diffuse_shares_kc is None:
            return np.zeros(len(self.mixing_levels_k))
        share_k: npt.NDArray[np.float64] = self.diffuse_shares_kc.sum(-1)
        return share_k


@dataclass(frozen=True)
class LocalizedSource:
    """One source of a clip.

    Args:
        azimuth: direction of arrival in radians, counter-clockwise from straight ahead.
        azimuth_std: posterior standard deviation of the azimuth in radians.
        level: mixing level, the share of time-frequency bins that the source dominates.
        level_std: posterior standard deviation of the level.
        direct_level: level of its direct sound, by which it counts as a source; at most ``level``.
        source_class: index k of the source class; of merged classes, that of the loudest.
        merged_classes: indices of the classes merged into it.

    >>> source = LocalizedSource(azimuth=math.pi / 2, azimuth_std=0.02, level=0.4, level_std=0.05, direct_level=0.3,
    ...     source_class=1)
    >>> source.azimuth_deg
    90.0
    """

    azimuth: float
    azimuth_std: float
    level: float
    level_std: float
    direct_level: float
    source_class: int
    merged_classes: tuple[int, ...] = ()

    @property
    def classes(self) -> tuple[int, ...]:
        """All source classes that make up this source."""
        return (self.source_class, *self.merged_classes)

    @property
    def azimuth_deg(self) -> float:
        """Direction of arrival in degrees: 0 is straight ahead, +90 left."""
        return math.degrees(self.azimuth)

    @property
    def azimuth_std_deg(self) -> float:
        """Posterior standard deviation of the azimuth in degrees."""
        return math.degrees(self.azimuth_std)


def peak_azimuth(weights_d: npt.NDArray[np.float64], grid: DirectionGrid) -> float:
    """Azimuth of the strongest direction, radians: Eq. (4), and finer than the grid by a parabola through log-weights.

    The parabola is exact for a peak of Gaussian shape.
    """
    peak = int(weights_d.argmax())
    around = (peak - 1, peak, (peak + 1) % len(weights_d))
    before, top, after = (math.log(max(float(weights_d[d]), sys.float_info.min)) for d in around)
    curvature = 2 * top - before - after
    # The azimuth falls as the index rises; a plateau has its peak anywhere, so take the middle of the block.
    offset = 0.5 * (after - before) / curvature if curvature > 0 else 0.0
    azimuth = math.pi - (peak + 0.5 + offset) * grid.spacing
    return math.remainder(azimuth, 2 * math.pi)


def merge_close(sources: list[LocalizedSource], merge_deg: float) -> tuple[LocalizedSource, ...]:
    """The sources with those closer than ``merge_deg`` degrees made one; levels add, the loudest come first."""
    # Merging moves a source, perhaps close to another; so the closest pair goes first, until none is left.
    while pair := _closest_pair(sources, np.deg2rad(merge_deg)):
        sources = [source for source in sources if source not in pair]
        sources.append(_merge(*sorted(pair, key=lambda source: -source.direct_level)))
    return tuple(sorted(sources, key=lambda source: -source.direct_level))


def _closest_pair(sources: list[LocalizedSource], within: float) -> tuple[LocalizedSource, LocalizedSource] | None:
    """The two sources at the smallest angle, if that is less than ``within`` (radians)."""

    def angle(pair: tuple[LocalizedSource, LocalizedSource]) -> float:
        # Not by numpy, whose scalars are ten times slower, in what tuning does a million times.
        return abs(math.remainder(pair[0].azimuth - pair[1].azimuth, 2 * math.pi))

    pair = min(combinations(sources, 2), key=angle, default=None)
    return pair if pair is not None and angle(pair) < within else None


def _merge(louder: LocalizedSource, other: LocalizedSource) -> LocalizedSource:
    direct_level = louder.direct_level + other.direct_level
    share = other.direct_level / direct_level if direct_level > 0 else 0.5
    offset = float(wrap_angle(other.azimuth - louder.azimuth))
    # Moments of the two-component mixture of directions, and the sum of two levels taken as independent.
    spread = (1 - share) * louder.azimuth_std**2 + share * other.azimuth_std**2 + share * (1 - share) * offset**2
    return LocalizedSource(
        azimuth=float(wrap_angle(louder.azimuth + share * offset)),
        azimuth_std=float(np.sqrt(spread)),
        level=louder.level + other.level,
        level_std=float(np.hypot(louder.level_std, other.level_std)),
        direct_level=direct_level,
        source_class=louder.source_class,
        merged_classes=(*louder.merged_classes, *other.classes),
    )

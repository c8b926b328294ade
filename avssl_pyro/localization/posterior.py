"""The posterior of one clip, and the sources selected from it."""

import math
import sys
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.validators import within


@dataclass(frozen=True)
class ClipPosterior:
    """Posterior means and spreads of one clip.

    Args:
        direction_weights_kd: expected direction weights, (K, D), each row summing to 1 (Eq. 1).
        mixing_levels_k: expected mixing levels, (K,), summing to 1.
        level_std_k: their posterior standard deviations, (K,).
        azimuth_std_k: posterior standard deviation of every class's peak direction, (K,), radians.
        activations_kij: 2-D activation maps over the image, (K, I', J'), or None without an image.
        diffuse_share_k: share of diffuse sound in the weights of every class, (K,), which the row sums of 1 leave out;
            None where the model has no diffuse weights.

    >>> weights_kd = np.full((2, 72), 1 / 72)
    >>> ClipPosterior(weights_kd, np.array([0.6, 0.4]), np.full(2, 0.01), np.full(2, 0.02)).mixing_levels_k.sum()
    np.float64(1.0)
    """

    direction_weights_kd: npt.NDArray[np.float64]
    mixing_levels_k: npt.NDArray[np.float64]
    level_std_k: npt.NDArray[np.float64]
    azimuth_std_k: npt.NDArray[np.float64]
    activations_kij: npt.NDArray[np.float32] | None = None
    diffuse_share_k: npt.NDArray[np.float64] | None = None


@dataclass(frozen=True)
class SourceThresholds:
    """Conditions under which a source class counts as a source.

    Args:
        level: least mixing level. The paper has 0.02; more classes and refined posteriors need more.
        peak: least weight of the strongest direction; classes below it are diffuse noise.
        merge_deg: angle in degrees; classes closer than this are one source.

    >>> SourceThresholds(level=0.1)
    SourceThresholds(level=0.1, peak=0.15, merge_deg=12.0)
    """

    level: float = 0.05
    peak: float = 0.15
    merge_deg: float = 12.0

    def __post_init__(self) -> None:
        within(0, 1).check(self, "level", "peak")
        within(0, 180).check(self, "merge_deg")


# Tuned on scenes in which some people are silent. One forward pass separates silent from sounding classes less well.
REFINED_THRESHOLDS = SourceThresholds(level=0.03, peak=0.2)
ONE_PASS_THRESHOLDS = SourceThresholds(level=0.08, peak=0.3)
AUDIO_ONLY_THRESHOLDS = SourceThresholds()


@dataclass(frozen=True)
class LocalizedSource:
    """One source of a clip.

    Args:
        azimuth: direction of arrival in radians, counter-clockwise from straight ahead.
        azimuth_std: posterior standard deviation of the azimuth in radians.
        level: mixing level, the share of time-frequency bins that the source dominates.
        level_std: posterior standard deviation of the level.
        source_class: index k of the source class; of merged classes, that of the loudest.
        merged_classes: indices of the classes merged into it.

    >>> source = LocalizedSource(azimuth=math.pi / 2, azimuth_std=0.02, level=0.4, level_std=0.05, source_class=1)
    >>> source.azimuth_deg
    90.0
    """

    azimuth: float
    azimuth_std: float
    level: float
    level_std: float
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


def select_sources(
    posterior: ClipPosterior, grid: DirectionGrid, thresholds: SourceThresholds
) -> tuple[LocalizedSource, ...]:
    """The sources of a clip, loudest first (the paper's Sec. III-B.3, with close classes merged).

    >>> grid = DirectionGrid(72)
    >>> weights_kd = np.full((2, 72), 1 / 72)
    >>> weights_kd[0] = 0.0
    >>> weights_kd[0, 18] = 1.0
    >>> posterior = ClipPosterior(weights_kd, np.array([0.6, 0.4]), np.full(2, 0.01), np.full(2, 0.02))
    >>> [round(source.azimuth_deg, 1) for source in select_sources(posterior, grid, REFINED_THRESHOLDS)]
    [87.5]
    """
    sources = [
        LocalizedSource(
            azimuth=peak_azimuth(weights_d, grid),
            azimuth_std=float(posterior.azimuth_std_k[k]),
            level=float(posterior.mixing_levels_k[k]),
            level_std=float(posterior.level_std_k[k]),
            source_class=k,
        )
        for k, weights_d in enumerate(posterior.direction_weights_kd)
        if posterior.mixing_levels_k[k] >= thresholds.level and weights_d.max() >= thresholds.peak
    ]
    return merge_close(sources, thresholds.merge_deg)


def merge_close(sources: list[LocalizedSource], merge_deg: float) -> tuple[LocalizedSource, ...]:
    """The sources with those closer than ``merge_deg`` degrees made one, whose levels add; loudest first."""
    # Merging moves a source, perhaps close to another; so the closest pair goes first, until none is left.
    while pair := _closest_pair(sources, np.deg2rad(merge_deg)):
        sources = [source for source in sources if source not in pair]
        sources.append(_merge(*sorted(pair, key=lambda source: -source.level)))
    return tuple(sorted(sources, key=lambda source: -source.level))


def _closest_pair(sources: list[LocalizedSource], within: float) -> tuple[LocalizedSource, LocalizedSource] | None:
    """The two sources at the smallest angle, if that is less than ``within`` (radians)."""

    def angle(pair: tuple[LocalizedSource, LocalizedSource]) -> float:
        # Not by numpy, whose scalars are ten times slower, in what tuning does a million times.
        return abs(math.remainder(pair[0].azimuth - pair[1].azimuth, 2 * math.pi))

    pair = min(combinations(sources, 2), key=angle, default=None)
    return pair if pair is not None and angle(pair) < within else None


def _merge(louder: LocalizedSource, other: LocalizedSource) -> LocalizedSource:
    level = louder.level + other.level
    share = other.level / level if level > 0 else 0.5
    offset = float(wrap_angle(other.azimuth - louder.azimuth))
    # Moments of the two-component mixture of directions, and the sum of two levels taken as independent.
    spread = (1 - share) * louder.azimuth_std**2 + share * other.azimuth_std**2 + share * (1 - share) * offset**2
    return LocalizedSource(
        azimuth=float(wrap_angle(louder.azimuth + share * offset)),
        azimuth_std=float(np.sqrt(spread)),
        level=level,
        level_std=float(np.hypot(louder.level_std, other.level_std)),
        source_class=louder.source_class,
        merged_classes=(*louder.merged_classes, *other.classes),
    )

"""Pixel geometry of a panorama that wraps around, and placement of boxes without overlap."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

MIN_WIDTH = 1152


@dataclass(frozen=True)
class PanoramaAxes:
    """Geometry of a panorama with a degree ruler below, in pixels; lines and letters scale with ``unit``.

    Args:
        width, image_height: size of the image, pixels.
        yaw: azimuth in the middle of the image, radians.
        mirror: True for an image with left and right exchanged.
    """

    width: int
    image_height: int
    yaw: float = 0.0
    mirror: bool = False

    @property
    def unit(self) -> float:
        return self.width / MIN_WIDTH

    @property
    def ruler_height(self) -> int:
        return round(34 * self.unit)

    @property
    def height(self) -> int:
        return self.image_height + self.ruler_height

    def column(self, azimuth: float) -> float:
        """Returns the column of an azimuth (radians), from 0 (left edge, +180 degrees without yaw) to the width."""
        turned = self.yaw - azimuth if not self.mirror else azimuth - self.yaw
        return float((np.pi + turned) % (2 * np.pi)) / (2 * np.pi) * self.width

    def distances(self, column: float) -> npt.NDArray[np.float32]:
        """Returns the circular distance of every pixel's centre from a column, (width,)."""
        offset_j = np.arange(self.width) + 0.5 - column
        return np.abs((offset_j + self.width / 2) % self.width - self.width / 2).astype(np.float32)

    def copies(self, left: float, right: float) -> Iterator[float]:
        """Yields shifts by whole turns that bring part of [left, right] into the image."""
        for shift in (-self.width, 0, self.width):
            if right + shift > 0 and left + shift < self.width:
                yield float(shift)


@dataclass(frozen=True)
class LabelBox:
    """A label's box, drawn at one height around one or two horizontal centers."""

    centers: tuple[float, ...]
    y: float


@dataclass(frozen=True)
class BoxSize:
    width: float
    height: float


def place_boxes(anchors: Sequence[tuple[float, float]], canvas: PanoramaAxes, size: BoxSize) -> list[LabelBox]:
    """Places a box above each anchor (x, y), moved up or down if it would overlap an earlier box.

    A box that would cross the seam is drawn whole at both edges.
    """
    gap = 3 * canvas.unit
    half = size.width / 2 + gap
    low, high = size.height / 2 + gap, canvas.image_height - size.height / 2 - gap
    placed: list[LabelBox] = []

    def overlaps(centers: tuple[float, ...], y: float) -> bool:
        return any(
            abs(y - other.y) < size.height + gap
            and any(abs(x - other_x) < size.width + gap for x in centers for other_x in other.centers)
            for other in placed
        )

    for x, row in anchors:
        inside = [float(np.clip(x + shift, half, canvas.width - half)) for shift in canvas.copies(x - half, x + half)]
        centers = tuple(inside)
        wish = row - 22 * canvas.unit - size.height / 2
        steps = [sign * step * (size.height + gap) for step in range(12) for sign in (-1, 1)]
        heights = [float(np.clip(wish + step, low, high)) for step in steps]
        y = next((height for height in heights if not overlaps(centers, height)), heights[0])
        placed.append(LabelBox(centers, y))
    return placed

"""Compositing of people into an equirectangular image, in correct perspective."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.clip import IMAGE_COLUMNS, IMAGE_ROWS


@dataclass(frozen=True)
class PanoramaView:
    """Geometry of an equirectangular image of all azimuths, with the horizon in the middle row.

    Args:
        rows, columns: size in pixels.
        oversampling: factor of the resolution at which people are rendered and averaged, for smooth edges.
    """

    rows: int
    columns: int
    oversampling: int = 3

    @property
    def pixel(self) -> float:
        """Angle between neighbouring pixels, radians."""
        return 2 * np.pi / self.columns

    @property
    def max_elevation(self) -> float:
        """Elevation of the upper edge, radians."""
        return self.rows * self.pixel / 2


CLIP_VIEW = PanoramaView(IMAGE_ROWS, IMAGE_COLUMNS)


@dataclass(frozen=True)
class PersonPosition:
    """Position of a standing person relative to a camera over the origin of the floor.

    Args:
        azimuth: azimuth of the head, radians.
        distance_m: distance along the floor, metres.
        height_m: height of the top of the head above the floor, metres.
    """

    azimuth: float
    distance_m: float
    height_m: float


@dataclass(frozen=True)
class PersonLayer:
    """Pixels of one person, on the rows and columns of the image that they cover.

    Args:
        rows: image rows, I of them.
        columns_j: image columns, (J,), wrapped at the seam.
        rgba_ijc: premultiplied color and opacity, float32 in [0, 1], (I, J, 4).
    """

    rows: slice
    columns_j: npt.NDArray[np.int64]
    rgba_ijc: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Composite:
    """An image with people.

    Args:
        image_ijc: uint8 RGB, (88, 288, 3).
        visible_pij: share of each pixel that shows each person, float32 in [0, 1], (P, 88, 288), without hidden parts.
    """

    image_ijc: npt.NDArray[np.uint8]
    visible_pij: npt.NDArray[np.float32]


def head_axis(cutout_ijc: npt.NDArray[np.uint8]) -> float:
    """Returns the horizontal centre of the head in a cut-out, in pixels from the left edge.

    The label is the azimuth of the mouth, so the head is placed there rather than the middle of the outline.
    """
    rows, columns = cutout_ijc.shape[:2]
    head_j = cutout_ijc[round(0.02 * rows) : max(round(0.12 * rows), 1), :, 3].sum(axis=0, dtype=np.float64)
    if head_j.sum() == 0.0:
        return float(columns / 2)
    return float(np.average(np.arange(columns) + 0.5, weights=head_j))


def project(
    cutout_ijc: npt.NDArray[np.uint8], position: PersonPosition, camera_height_m: float, view: PanoramaView = CLIP_VIEW
) -> PersonLayer:
    """Projects a cut-out, an upright flat board that faces the camera, into the image.

    The ray at azimuth a meets the board's plane at the lateral offset ``d tan(a - azimuth)`` and at the distance
    ``r = d / cos(a - azimuth)`` along the floor, so the ray at elevation e meets it ``camera_height + r tan e`` above
    the floor.

    Args:
        cutout_ijc: uint8 RGBA, (H, W, 4), feet at the bottom edge.
        position: position of the person.
        camera_height_m: height of the camera above the floor, metres.
        view: geometry of the image.
    """
    rows, columns = cutout_ijc.shape[:2]
    metre = rows / position.height_m
    axis = head_axis(cutout_ijc)
    left = float(np.arctan(axis / metre / position.distance_m))
    right = float(np.arctan((columns - axis) / metre / position.distance_m))
    pixel, times = view.pixel, view.oversampling
    first = int(np.floor((np.pi - position.azimuth - left) / pixel))
    last = int(np.ceil((np.pi - position.azimuth + right) / pixel))
    offset_j = np.pi - (first + (np.arange((last - first) * times) + 0.5) / times) * pixel
    offset_j = np.clip(offset_j - position.azimuth, -0.499 * np.pi, 0.499 * np.pi)
    # A body ends at its head and feet where they are nearest to the camera; the margin covers interpolation.
    head = np.arctan2(max(position.height_m - camera_height_m, 0.0), position.distance_m)
    feet = np.arctan2(-camera_height_m, position.distance_m)
    top = max(0, int(np.floor((view.max_elevation - head) / pixel)) - 2)
    bottom = min(view.rows, int(np.ceil((view.max_elevation - feet) / pixel)) + 2)
    elevation_i = view.max_elevation - (np.arange(top * times, bottom * times) + 0.5) * (pixel / times)
    height_ij = camera_height_m + position.distance_m / np.cos(offset_j) * np.tan(elevation_i)[:, None]
    row_ij = ((position.height_m - height_ij) * metre - 0.5).astype(np.float32)
    column_j = (axis - position.distance_m * np.tan(offset_j) * metre - 0.5).astype(np.float32)
    column_ij = np.ascontiguousarray(np.broadcast_to(column_j, row_ij.shape))
    projected_ijc = cv2.remap(
        _premultiplied(cutout_ijc), column_ij, row_ij, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0
    )
    if times > 1:
        projected_ijc = cv2.resize(projected_ijc, (last - first, bottom - top), interpolation=cv2.INTER_AREA)
    return PersonLayer(
        slice(top, bottom), np.arange(first, last) % view.columns, np.asarray(projected_ijc, dtype=np.float32)
    )


def _premultiplied(cutout_ijc: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    rgba_ijc = cutout_ijc.astype(np.float32) / np.float32(255)
    rgba_ijc[..., :3] *= rgba_ijc[..., 3:]
    return rgba_ijc


def composite(
    background_ijc: npt.NDArray[np.uint8],
    cutouts: list[npt.NDArray[np.uint8]],
    positions: list[PersonPosition],
    camera_height_m: float,
) -> Composite:
    """Composites people into a panorama, nearer ones in front, wrapped at the seam.

    Args:
        background_ijc: uint8 RGB, (88, 288, 3).
        cutouts: RGBA cut-out of each person, of any size.
        positions: position of each person.
        camera_height_m: height of the camera above the floor, metres.
    """
    canvas_ijc = background_ijc.astype(np.float32)
    visible_pij = np.zeros((len(positions), IMAGE_ROWS, IMAGE_COLUMNS), dtype=np.float32)
    for person in sorted(range(len(positions)), key=lambda index: -positions[index].distance_m):
        layer = project(cutouts[person], positions[person], camera_height_m)
        canvas_ijc[layer.rows, layer.columns_j] = blend_layer(canvas_ijc, layer)
        visible_pij[:, layer.rows, layer.columns_j] *= 1 - layer.rgba_ijc[..., 3]
        visible_pij[person][layer.rows, layer.columns_j] = layer.rgba_ijc[..., 3]
    return Composite(np.clip(np.rint(canvas_ijc), 0, 255).astype(np.uint8), visible_pij)


def blend_layer(
    canvas_ijc: npt.NDArray[np.float32] | npt.NDArray[np.uint8], layer: PersonLayer
) -> npt.NDArray[np.float32]:
    """Returns the covered part of a canvas (0 to 255), (I, J, 3), with a person's layer in front."""
    below_ijc = canvas_ijc[layer.rows, layer.columns_j]
    blended_ijc: npt.NDArray[np.float32] = below_ijc * (1 - layer.rgba_ijc[..., 3:]) + 255 * layer.rgba_ijc[..., :3]
    return blended_ijc


def relight(image_ijc: npt.NDArray[np.uint8], rng: np.random.Generator, strength: float = 1.0) -> npt.NDArray[np.uint8]:
    """Changes the lighting of an image by a random gain, gamma and tint; an alpha channel stays.

    Args:
        image_ijc: uint8 RGB or RGBA.
        rng: random gain, gamma and tint.
        strength: scale of the change; 1 spreads gain over 0.7-1.16, gamma over 0.77-1.3 and tint by 5 %; 0 changes
            nothing.
    """
    gain, gamma = np.exp(strength * rng.uniform((-0.35, -0.26), (0.15, 0.26)))
    tint_c = np.exp(strength * rng.normal(0.0, 0.05, 3))
    level = np.linspace(0.0, 1.0, 256)[:, None] ** gamma
    table = np.clip(np.rint(255 * gain * tint_c * level), 0, 255).astype(np.uint8)
    lit_ijc = image_ijc.copy()
    for color in range(3):
        lit_ijc[..., color] = table[:, color][image_ijc[..., color]]
    return lit_ijc

"""Puts cut-outs of people into an equirectangular image in correct perspective."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.clip import IMAGE_COLUMNS, IMAGE_ROWS


@dataclass(frozen=True)
class View:
    """An equirectangular image of all azimuths and of elevations as far up as down.

    Args:
        rows, columns: size in pixels.
        oversampling: rendering at so many times the resolution and averaging keeps the edges of people smooth.
    """

    rows: int
    columns: int
    oversampling: int = 3

    @property
    def pixel(self) -> float:
        """Radians."""
        return 2 * np.pi / self.columns

    @property
    def max_elevation(self) -> float:
        """Of the upper edge, radians."""
        return self.rows * self.pixel / 2


CLIP_VIEW = View(IMAGE_ROWS, IMAGE_COLUMNS)


@dataclass(frozen=True)
class Standing:
    """Where a person stands, seen from a camera at the origin of the floor plan.

    Args:
        azimuth: of the head, radians.
        distance_m: along the floor.
        height_m: from the floor to the top of the head.
    """

    azimuth: float
    distance_m: float
    height_m: float


@dataclass(frozen=True)
class Layer:
    """What one person adds to the image, on the rows and columns it touches.

    Args:
        rows: image rows, I of them.
        columns_j: image columns, (J,), already wrapped at the seam.
        rgba_ijc: premultiplied color and coverage, float32 in [0, 1], (I, J, 4).
    """

    rows: slice
    columns_j: npt.NDArray[np.int64]
    rgba_ijc: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Composite:
    """An image with people.

    Args:
        image_ijc: uint8 RGB, (88, 288, 3).
        visible_pij: share of each pixel that shows each person, float32 in [0, 1], (P, 88, 288), hidden parts left out.
    """

    image_ijc: npt.NDArray[np.uint8]
    visible_pij: npt.NDArray[np.float32]


def head_axis(cutout_ijc: npt.NDArray[np.uint8]) -> float:
    """Horizontal centre of the head in a cut-out, in pixels from its left edge.

    The voice comes from the head, so the head, not the middle of the outline, stands at the labelled azimuth.
    """
    rows, columns = cutout_ijc.shape[:2]
    head_j = cutout_ijc[round(0.02 * rows) : max(round(0.12 * rows), 1), :, 3].sum(axis=0, dtype=np.float64)
    if head_j.sum() == 0.0:
        return float(columns / 2)
    return float(np.average(np.arange(columns) + 0.5, weights=head_j))


def project(
    cutout_ijc: npt.NDArray[np.uint8], standing: Standing, camera_height_m: float, view: View = CLIP_VIEW
) -> Layer:
    """A cut-out as the camera sees it: a flat board upright on the floor, facing the camera.

    The ray at azimuth a meets the board's plane at the lateral offset ``d tan(a - azimuth)`` and at the distance
    ``r = d / cos(a - azimuth)`` along the floor, so the ray at elevation e meets it ``camera_height + r tan e`` above
    the floor.

    Args:
        cutout_ijc: uint8 RGBA, (H, W, 4), feet at the bottom edge.
        standing: where the person stands.
        camera_height_m: above the floor.
        view: what the camera's image shows.
    """
    rows, columns = cutout_ijc.shape[:2]
    metre = rows / standing.height_m
    axis = head_axis(cutout_ijc)
    left = float(np.arctan(axis / metre / standing.distance_m))
    right = float(np.arctan((columns - axis) / metre / standing.distance_m))
    pixel, times = view.pixel, view.oversampling
    first = int(np.floor((np.pi - standing.azimuth - left) / pixel))
    last = int(np.ceil((np.pi - standing.azimuth + right) / pixel))
    offset_j = np.pi - (first + (np.arange((last - first) * times) + 0.5) / times) * pixel
    offset_j = np.clip(offset_j - standing.azimuth, -0.499 * np.pi, 0.499 * np.pi)
    # Nothing of a body lies above its head or below its feet where they are nearest; a pixel to spare.
    head = np.arctan2(max(standing.height_m - camera_height_m, 0.0), standing.distance_m)
    feet = np.arctan2(-camera_height_m, standing.distance_m)
    top = max(0, int(np.floor((view.max_elevation - head) / pixel)) - 2)
    bottom = min(view.rows, int(np.ceil((view.max_elevation - feet) / pixel)) + 2)
    elevation_i = view.max_elevation - (np.arange(top * times, bottom * times) + 0.5) * (pixel / times)
    height_ij = camera_height_m + standing.distance_m / np.cos(offset_j) * np.tan(elevation_i)[:, None]
    row_ij = ((standing.height_m - height_ij) * metre - 0.5).astype(np.float32)
    column_j = (axis - standing.distance_m * np.tan(offset_j) * metre - 0.5).astype(np.float32)
    column_ij = np.ascontiguousarray(np.broadcast_to(column_j, row_ij.shape))
    seen_ijc = cv2.remap(
        _premultiplied(cutout_ijc), column_ij, row_ij, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0
    )
    if times > 1:
        seen_ijc = cv2.resize(seen_ijc, (last - first, bottom - top), interpolation=cv2.INTER_AREA)
    return Layer(slice(top, bottom), np.arange(first, last) % view.columns, np.asarray(seen_ijc, dtype=np.float32))


def _premultiplied(cutout_ijc: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    rgba_ijc = cutout_ijc.astype(np.float32) / np.float32(255)
    rgba_ijc[..., :3] *= rgba_ijc[..., 3:]
    return rgba_ijc


def composite(
    background_ijc: npt.NDArray[np.uint8],
    cutouts: list[npt.NDArray[np.uint8]],
    places: list[Standing],
    camera_height_m: float,
) -> Composite:
    """People in a panorama, nearer ones in front, wrapped at the seam.

    Args:
        background_ijc: uint8 RGB, (88, 288, 3).
        cutouts: one RGBA cut-out per person, of any size.
        places: where each stands.
        camera_height_m: above the floor.
    """
    canvas_ijc = background_ijc.astype(np.float32)
    visible_pij = np.zeros((len(places), IMAGE_ROWS, IMAGE_COLUMNS), dtype=np.float32)
    for person in sorted(range(len(places)), key=lambda index: -places[index].distance_m):
        layer = project(cutouts[person], places[person], camera_height_m)
        canvas_ijc[layer.rows, layer.columns_j] = blend(canvas_ijc, layer)
        visible_pij[:, layer.rows, layer.columns_j] *= 1 - layer.rgba_ijc[..., 3]
        visible_pij[person][layer.rows, layer.columns_j] = layer.rgba_ijc[..., 3]
    return Composite(np.clip(np.rint(canvas_ijc), 0, 255).astype(np.uint8), visible_pij)


def blend(canvas_ijc: npt.NDArray[np.float32] | npt.NDArray[np.uint8], layer: Layer) -> npt.NDArray[np.float32]:
    """The part of a canvas (0 to 255) that a layer touches, (I, J, 3), with the layer in front of it."""
    below_ijc = canvas_ijc[layer.rows, layer.columns_j]
    blended_ijc: npt.NDArray[np.float32] = below_ijc * (1 - layer.rgba_ijc[..., 3:]) + 255 * layer.rgba_ijc[..., :3]
    return blended_ijc


def relight(image_ijc: npt.NDArray[np.uint8], rng: np.random.Generator, strength: float = 1.0) -> npt.NDArray[np.uint8]:
    """The image under another light: random gain, gamma and tint; a fourth channel (alpha) stays.

    Args:
        image_ijc: uint8 RGB or RGBA.
        rng: source of the light.
        strength: 1 spreads gain over 0.7-1.16, gamma over 0.77-1.3 and tint by 5 %; 0 changes nothing.
    """
    gain, gamma = np.exp(strength * rng.uniform((-0.35, -0.26), (0.15, 0.26)))
    tint_c = np.exp(strength * rng.normal(0.0, 0.05, 3))
    level = np.linspace(0.0, 1.0, 256)[:, None] ** gamma
    table = np.clip(np.rint(255 * gain * tint_c * level), 0, 255).astype(np.uint8)
    lit_ijc = image_ijc.copy()
    for color in range(3):
        lit_ijc[..., color] = table[:, color][image_ijc[..., color]]
    return lit_ijc

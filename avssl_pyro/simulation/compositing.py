"""Puts cut-outs of people into an equirectangular image in correct perspective."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.data.clip import IMAGE_COLUMNS, IMAGE_MAX_ELEVATION_DEG, IMAGE_ROWS

# Rendering at three times the resolution and averaging keeps edges smooth.
OVERSAMPLING = 3
PIXEL = 2 * np.pi / IMAGE_COLUMNS


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
    """What one person adds to the image, on the columns it touches.

    Args:
        columns_j: image columns, (J,), already wrapped at the seam.
        rgba_ijc: premultiplied color and coverage, float32 in [0, 1], (88, J, 4).
    """

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


def project(cutout_ijc: npt.NDArray[np.uint8], standing: Standing, camera_height_m: float) -> Layer:
    """A cut-out as the camera sees it: a flat board upright on the floor, facing the camera.

    The ray at azimuth a meets the board's plane at the lateral offset ``d tan(a - azimuth)`` and at the distance
    ``r = d / cos(a - azimuth)`` along the floor, so the ray at elevation e meets it ``camera_height + r tan e`` above
    the floor.

    Args:
        cutout_ijc: uint8 RGBA, (H, W, 4), feet at the bottom edge.
        standing: where the person stands.
        camera_height_m: above the floor.
    """
    rows, columns = cutout_ijc.shape[:2]
    metre = rows / standing.height_m
    axis = head_axis(cutout_ijc)
    left = float(np.arctan(axis / metre / standing.distance_m))
    right = float(np.arctan((columns - axis) / metre / standing.distance_m))
    first = int(np.floor((np.pi - standing.azimuth - left) / PIXEL))
    last = int(np.ceil((np.pi - standing.azimuth + right) / PIXEL))
    fine = PIXEL / OVERSAMPLING
    offset_j = np.pi - (first + (np.arange((last - first) * OVERSAMPLING) + 0.5) / OVERSAMPLING) * PIXEL
    offset_j = np.clip(offset_j - standing.azimuth, -0.499 * np.pi, 0.499 * np.pi)
    elevation_i = np.deg2rad(IMAGE_MAX_ELEVATION_DEG) - (np.arange(IMAGE_ROWS * OVERSAMPLING) + 0.5) * fine
    height_ij = camera_height_m + standing.distance_m / np.cos(offset_j) * np.tan(elevation_i)[:, None]
    row_ij = ((standing.height_m - height_ij) * metre - 0.5).astype(np.float32)
    column_j = (axis - standing.distance_m * np.tan(offset_j) * metre - 0.5).astype(np.float32)
    column_ij = np.ascontiguousarray(np.broadcast_to(column_j, row_ij.shape))
    seen_ijc = cv2.remap(
        _premultiplied(cutout_ijc), column_ij, row_ij, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0
    )
    rgba_ijc = cv2.resize(seen_ijc, (last - first, IMAGE_ROWS), interpolation=cv2.INTER_AREA)
    return Layer(np.arange(first, last) % IMAGE_COLUMNS, np.asarray(rgba_ijc, dtype=np.float32))


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
        color_ijc, cover_ij1 = 255 * layer.rgba_ijc[..., :3], layer.rgba_ijc[..., 3:]
        canvas_ijc[:, layer.columns_j] = canvas_ijc[:, layer.columns_j] * (1 - cover_ij1) + color_ijc
        visible_pij[:, :, layer.columns_j] *= 1 - cover_ij1[..., 0]
        visible_pij[person][:, layer.columns_j] = cover_ij1[..., 0]
    return Composite(np.clip(np.rint(canvas_ijc), 0, 255).astype(np.uint8), visible_pij)


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

"""Activation maps of source classes as colors over an equirectangular image."""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.viz.palette import Color

# The photograph is paler and darker, so that its colors are not taken for colors of classes.
PHOTO_SATURATION, PHOTO_BRIGHTNESS = 0.5, 0.9
MAX_OPACITY = 0.8


def resize_circular(map_ij: npt.NDArray[np.float32], rows: int, columns: int) -> npt.NDArray[np.float32]:
    """Resizes a map to (rows, columns), with linear interpolation across the seam of its left and right edge."""
    margin = 2
    padded = np.pad(map_ij.astype(np.float32), ((0, 0), (margin, margin)), mode="wrap")
    factor = columns / map_ij.shape[1]
    source_j = ((np.arange(columns) + 0.5) / factor - 0.5 + margin).astype(np.float32)
    source_i = ((np.arange(rows) + 0.5) * map_ij.shape[0] / rows - 0.5).astype(np.float32)
    grid_j, grid_i = np.meshgrid(source_j, source_i)
    stretched = cv2.remap(padded, grid_j, grid_i, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(stretched, dtype=np.float32)


def strength_maps(
    direction_weights_kd: npt.NDArray[np.floating], activations_kij: npt.NDArray[np.floating] | None
) -> npt.NDArray[np.float32]:
    """Returns the activation of every class relative to its maximum, (K, I, J) in [0, 1].

    Activations are log-weights, as their maximum over rows enters the softmax of Eq. (1); their exponential is shown.
    Without activations, the weight of each direction fills its column.
    """
    if activations_kij is None:
        weights_kd = np.asarray(direction_weights_kd, dtype=np.float32)
        relative_kd = weights_kd / np.maximum(weights_kd.max(axis=-1, keepdims=True), 1e-12)
        return np.asarray(relative_kd[:, None, :], dtype=np.float32)
    maps_kij = np.asarray(activations_kij, dtype=np.float32)
    return np.asarray(np.exp(maps_kij - maps_kij.max(axis=(1, 2), keepdims=True)), dtype=np.float32)


def desaturate(image_ijc: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Reduces saturation and brightness of an image; returns RGB in [0, 1]."""
    photo = image_ijc.astype(np.float32) / 255
    gray = photo @ np.array([0.299, 0.587, 0.114], dtype=np.float32)
    muted = PHOTO_BRIGHTNESS * (PHOTO_SATURATION * photo + (1 - PHOTO_SATURATION) * gray[..., None])
    return muted.astype(np.float32)


def blend_class_colors(
    base_ijc: npt.NDArray[np.float32],
    strength_kij: npt.NDArray[np.float32],
    colors: Sequence[Color],
    emphasis: Sequence[float],
) -> npt.NDArray[np.float32]:
    """Blends the colors of the classes over an image of the size of the maps.

    Args:
        base_ijc: image, RGB in [0, 1].
        strength_kij: opacity per class and pixel before emphasis, in [0, 1].
        colors: color of each class.
        emphasis: factor of each class's opacity, 0 to 1.
    """
    out = base_ijc.copy()
    for strength_ij, color, weight in zip(strength_kij, colors, emphasis, strict=True):
        if weight <= 0:
            continue
        opacity = (MAX_OPACITY * weight * strength_ij)[..., None]
        out = out * (1 - opacity) + np.array(color, dtype=np.float32) * opacity
    return out

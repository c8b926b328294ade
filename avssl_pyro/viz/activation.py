"""Activation maps of the source classes as color over an equirectangular image."""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.viz.palette import Color

# The photograph steps back a little, so that colors on it are colors of classes.
PHOTO_SATURATION, PHOTO_BRIGHTNESS = 0.5, 0.9
MAX_OPACITY = 0.8


def resize_circular(map_ij: npt.NDArray[np.float32], rows: int, columns: int) -> npt.NDArray[np.float32]:
    """A map stretched over (rows, columns), linearly interpolated across the seam between right and left edge."""
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
    """How much every point belongs to a class, relative to the class's own maximum, (K, i, j) in [0, 1].

    Activations are log-weights (their vertical maximum feeds the softmax of Eq. (1)), so their exponential is compared.
    Without activations, each direction's weight fills its column, as a band.
    """
    if activations_kij is None:
        weights_kd = np.asarray(direction_weights_kd, dtype=np.float32)
        relative_kd = weights_kd / np.maximum(weights_kd.max(axis=-1, keepdims=True), 1e-12)
        return np.asarray(relative_kd[:, None, :], dtype=np.float32)
    maps_kij = np.asarray(activations_kij, dtype=np.float32)
    return np.asarray(np.exp(maps_kij - maps_kij.max(axis=(1, 2), keepdims=True)), dtype=np.float32)


def mute(image_ijc: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """The photograph, paler and darker, RGB in [0, 1]."""
    photo = image_ijc.astype(np.float32) / 255
    gray = photo @ np.array([0.299, 0.587, 0.114], dtype=np.float32)
    muted = PHOTO_BRIGHTNESS * (PHOTO_SATURATION * photo + (1 - PHOTO_SATURATION) * gray[..., None])
    return muted.astype(np.float32)


def blend(
    base_ijc: npt.NDArray[np.float32],
    strength_kij: npt.NDArray[np.float32],
    colors: Sequence[Color],
    emphasis: Sequence[float],
) -> npt.NDArray[np.float32]:
    """Lays the classes' colors over an image of the size of the maps.

    Args:
        base_ijc: RGB in [0, 1].
        strength_kij: opacity per class and pixel before emphasis, in [0, 1].
        colors: of each class.
        emphasis: of each class, 0 hides it and 1 shows it fully.
    """
    out = base_ijc.copy()
    for strength_ij, color, weight in zip(strength_kij, colors, emphasis, strict=True):
        if weight <= 0:
            continue
        opacity = (MAX_OPACITY * weight * strength_ij)[..., None]
        out = out * (1 - opacity) + np.array(color, dtype=np.float32) * opacity
    return out

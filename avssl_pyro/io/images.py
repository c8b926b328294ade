"""Image files: panoramas fitted to the model's 88 x 288 pixels, and PNG written whole or not at all."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.clip import IMAGE_COLUMNS, IMAGE_MAX_ELEVATION_DEG, IMAGE_ROWS
from avssl_pyro.errors import InputError
from avssl_pyro.io.projection_check import check_equirectangular


def read_image(path: Path) -> npt.NDArray[np.uint8]:
    """Reads a full-sphere (2:1) or an 88 x 288 equirectangular image as uint8 RGB (88, 288, 3).

    Raises:
        InputError: the file cannot be read, has other proportions, or comes from a fisheye lens.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such image file.")
    content = np.fromfile(path, dtype=np.uint8)
    image_ijc = cv2.imdecode(content, cv2.IMREAD_COLOR_RGB) if content.size else None
    if image_ijc is None:
        raise InputError(f"{path}: cannot be read as an image; give JPEG or PNG.")
    return fit_panorama(image_ijc.astype(np.uint8), str(path))


def fit_panorama(image_ijc: npt.NDArray[np.uint8], where: str) -> npt.NDArray[np.uint8]:
    """Fits an equirectangular image as :func:`fit_image`; refuses fisheye images.

    Raises:
        InputError: the image has other proportions, or comes from a fisheye lens.
    """
    fitted_ijc = fit_image(image_ijc, where)
    if is_full_sphere(image_ijc):
        check_equirectangular(image_ijc, where)
    return fitted_ijc


def is_full_sphere(image_ijc: npt.NDArray[np.generic]) -> bool:
    """Whether an image is twice as wide as high."""
    rows, columns = image_ijc.shape[:2]
    return abs(columns - 2 * rows) <= 2


def fit_image(image_ijc: npt.NDArray[np.uint8], where: str) -> npt.NDArray[np.uint8]:
    """Crops a full sphere to elevations -55..55 degrees and scales it to 88 x 288.

    Raises:
        InputError: the image is neither a full sphere (twice as wide as high) nor has the proportions of 88 x 288.
    """
    rows, columns = image_ijc.shape[:2]
    if is_full_sphere(image_ijc):
        margin = round(rows * (90.0 - IMAGE_MAX_ELEVATION_DEG) / 180.0)
        image_ijc = image_ijc[margin : rows - margin]
    elif abs(columns * IMAGE_ROWS - rows * IMAGE_COLUMNS) > 2 * IMAGE_COLUMNS:
        raise InputError(
            f"{where}: {columns} x {rows} pixels; a 360-degree image is twice as wide as high (full sphere), or has "
            f"the proportions {IMAGE_COLUMNS} x {IMAGE_ROWS} (elevations -55 to 55 degrees)."
        )
    if columns < IMAGE_COLUMNS // 2:
        raise InputError(f"{where}: only {columns} pixels wide; give an image of at least {IMAGE_COLUMNS // 2}.")
    if image_ijc.shape[:2] == (IMAGE_ROWS, IMAGE_COLUMNS):
        return image_ijc
    shrinks = image_ijc.shape[1] >= IMAGE_COLUMNS
    resized = cv2.resize(
        image_ijc, (IMAGE_COLUMNS, IMAGE_ROWS), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    )
    return np.asarray(resized, dtype=np.uint8)


def write_png(path: Path, encoded: bytes) -> None:
    """Writes an encoded PNG image, and creates its folder where missing.

    Raises:
        OSError: the file cannot be written; nothing is left behind.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, encoded)


def save_png(path: Path, image_ijc: npt.NDArray[np.uint8]) -> None:
    """Encodes and writes an RGB image, (I, J, 3); see :func:`write_png`."""
    _, encoded = cv2.imencode(".png", cv2.cvtColor(image_ijc, cv2.COLOR_RGB2BGR))
    write_png(path, encoded.tobytes())

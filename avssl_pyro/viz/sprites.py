"""Sprites: small transparent pictures of boxes and text, drawn once and used on many frames."""

from pathlib import Path

import cv2
import matplotlib
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from avssl_pyro.viz.palette import Color

FONT_FOLDER = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
# Oversampling of boxes, for smooth round corners.
FINER = 4


class Sprite:
    """A transparent picture that is drawn onto frames.

    Sixteen bits hold bytes times 256 and blend several times faster than floats.

    Args:
        rows, columns: size of the picture, pixels.
    """

    def __init__(self, rows: int, columns: int) -> None:
        self.rows, self.columns = rows, columns
        self._kept_ij1 = np.full((rows, columns, 1), 256, dtype=np.uint16)
        self._added_ijc = np.zeros((rows, columns, 3), dtype=np.uint16)

    def paint(self, mask_ij: npt.NDArray[np.float32], color: Color, opacity: float = 1.0) -> None:
        """Paints a color through a centred mask with values in [0, 1], at most as large as the sprite."""
        rows, columns = mask_ij.shape
        top, left = (self.rows - rows) // 2, (self.columns - columns) // 2
        inside = (slice(top, top + rows), slice(left, left + columns))
        through_ij1 = opacity * mask_ij[:, :, None]
        paint = 255 * 256 * np.asarray(color, dtype=np.float32)
        self._kept_ij1[inside] = np.floor(self._kept_ij1[inside] * (1 - through_ij1))
        self._added_ijc[inside] = np.floor(self._added_ijc[inside] * (1 - through_ij1) + paint * through_ij1)

    def draw_onto(self, image_ijc: npt.NDArray[np.uint8], center_x: float, center_y: float) -> None:
        """Draws the sprite onto an RGB image in place, cut off at the edges."""
        # The small offset makes equal fractions round the same way.
        top, left = round(center_y - self.rows / 2 + 1e-6), round(center_x - self.columns / 2 + 1e-6)
        i, j = max(top, 0), max(left, 0)
        under_ijc = image_ijc[i : max(top + self.rows, 0), j : max(left + self.columns, 0)]
        rows, columns = under_ijc.shape[:2]
        part = (slice(i - top, i - top + rows), slice(j - left, j - left + columns))
        under_ijc[:] = (under_ijc * self._kept_ij1[part] + self._added_ijc[part]) >> 8


class TextRenderer:
    """Renders text in the font of the project's figures.

    Args:
        size: height of the font, pixels.
        bold: True for a bold font.
    """

    def __init__(self, size: float, bold: bool = False) -> None:
        name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
        self._font = ImageFont.truetype(FONT_FOLDER / name, max(6, round(size)))
        ascent, descent = self._font.getmetrics()
        self.height = ascent + descent

    def mask(self, text: str) -> npt.NDArray[np.float32]:
        """Returns the opacity of the letters, (rows, columns) in [0, 1], of equal height for every text."""
        canvas = Image.new("L", (max(1, round(self._font.getlength(text))), self.height))
        ImageDraw.Draw(canvas).text((0, 0), text, font=self._font, fill=255)
        return np.asarray(canvas, dtype=np.float32) / np.float32(255)

    def sprite(self, text: str, color: Color, opacity: float = 1.0) -> Sprite:
        """Renders text without a background."""
        mask_ij = self.mask(text)
        sprite = Sprite(*mask_ij.shape)
        sprite.paint(mask_ij, color, opacity)
        return sprite


def rounded_box(rows: int, columns: int, radius: float) -> npt.NDArray[np.float32]:
    """Returns the opacity of a box with round corners, (rows, columns) in [0, 1]."""
    fine = Image.new("L", (columns * FINER, rows * FINER))
    ImageDraw.Draw(fine).rounded_rectangle(
        (0, 0, columns * FINER - 1, rows * FINER - 1), radius=radius * FINER, fill=255
    )
    fine_ij = np.asarray(fine, dtype=np.float32) / 255
    return np.asarray(cv2.resize(fine_ij, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.float32)

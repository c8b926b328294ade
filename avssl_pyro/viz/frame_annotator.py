"""Frames of an annotated video: the camera's picture with its sources, and the azimuth strip below."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.tracking.timeline import IdentifiedSource, Timeline
from avssl_pyro.viz.azimuth_strip import AzimuthStrip
from avssl_pyro.viz.palette import Color, ink_on, track_colors
from avssl_pyro.viz.panorama_axes import BoxSize, PanoramaAxes, place_boxes
from avssl_pyro.viz.sprites import Sprite, TextRenderer, rounded_box

# Least width for readable letters, and greatest width for browsers and two cores.
MIN_FRAME_WIDTH, MAX_FRAME_WIDTH = 960, 1920
# Labels change this often, in seconds; numbers that change with every frame are not readable.
LABEL_S = 0.25
# Cached labels, enough for some seconds; others are drawn again.
MAX_SPRITES = 256
INK: dict[str, Color] = {"black": (0.05, 0.05, 0.05), "white": (1.0, 1.0, 1.0)}
DARK: Color = (0.06, 0.07, 0.08)
# A source's column glows this far each way where no spread is shown (radians), and so strongly; a wider spread than the
# widest glow is on the strip only, or it would color the whole picture.
GLOW, WIDEST_GLOW, GLOW_OPACITY = np.deg2rad(4.0), np.deg2rad(12.0), 0.3


@dataclass(frozen=True)
class AnnotationStyle:
    """Settings of an annotated video.

    Args:
        yaw: azimuth of the picture's centre column in the array's coordinates, radians.
        mirror: True for a picture with left and right exchanged.
        show_spread: True writes and draws standard deviations.
    """

    yaw: float = 0.0
    mirror: bool = False
    show_spread: bool = False


class FrameAnnotator:
    """Annotates the frames of one video; marks that cross the picture's edge continue at the other side.

    Each source has a line, a glow and a labelled box in its color at its azimuth, and a bar and a trail on the azimuth
    strip. The label has the number of the source and its mixing level.

    Args:
        rows, columns: size of the video's frames; those narrower than 960 are enlarged by a whole number, those wider
            than 1920 made smaller.
        timeline: sources over time.
        style: settings of the video.
    """

    def __init__(self, rows: int, columns: int, timeline: Timeline, style: AnnotationStyle) -> None:
        factor = MAX_FRAME_WIDTH / columns if columns > MAX_FRAME_WIDTH else max(1, -(-MIN_FRAME_WIDTH // columns))
        # H.264 halves the resolution of colors: both sides must be even.
        self.width = 2 * round(columns * factor / 2)
        self._picture_rows = round(rows * factor)
        self._style = style
        self._timeline = timeline
        self._canvas = PanoramaAxes(self.width, self._picture_rows, style.yaw, style.mirror)
        self._colors = track_colors(timeline)
        self._strip = AzimuthStrip(self._canvas, timeline, self._colors, style.show_spread)
        self.height = 2 * -(-(self._picture_rows + self._strip.height) // 2)
        self._unit = self.width / 1152
        self._label = TextRenderer(15 * self._unit, bold=True)
        self._clock = TextRenderer(14 * self._unit)
        self._sprites: dict[tuple[str, Color], Sprite] = {}

    def draw(self, frame_ijc: npt.NDArray[np.uint8], time_s: float) -> npt.NDArray[np.uint8]:
        """Annotates one frame.

        Args:
            frame_ijc: frame, RGB, (rows, columns, 3).
            time_s: time of the frame on the timeline, seconds.

        Returns:
            uint8 RGB, (height, width, 3), both even.
        """
        page_ijc = np.empty((self.height, self.width, 3), dtype=np.uint8)
        page_ijc[-1] = 0
        picture_ijc = page_ijc[: self._picture_rows]
        if frame_ijc.shape[:2] == picture_ijc.shape[:2]:
            picture_ijc[:] = frame_ijc
        else:
            shrinks = frame_ijc.shape[1] > self.width
            how = cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC
            picture_ijc[:] = cv2.resize(frame_ijc, (self.width, self._picture_rows), interpolation=how)
        sources = self._timeline.at(time_s)
        self._draw_columns(picture_ijc, sources)
        self._draw_labels(picture_ijc, sources, time_s)
        self._draw_clock(picture_ijc, time_s)
        strip_ijc = page_ijc[self._picture_rows : self._picture_rows + self._strip.height]
        self._strip.draw(strip_ijc, time_s, sources)
        return page_ijc

    def _draw_columns(self, picture_ijc: npt.NDArray[np.uint8], sources: Sequence[IdentifiedSource]) -> None:
        """Draws glows and lines, which are equal in every row."""
        kept_j = np.ones(self.width, dtype=np.float32)
        added_jc = np.zeros((self.width, 3), dtype=np.float32)

        def paint(opacity_j: npt.NDArray[np.float32], color: Color) -> None:
            added_jc[:] = added_jc * (1 - opacity_j[:, None]) + 255 * opacity_j[:, None] * np.asarray(color, np.float32)
            kept_j[:] *= 1 - opacity_j

        for source in sources:
            color = self._colors[source.name]
            distance_j = self._canvas.distances(self._canvas.column(source.azimuth))
            spread = np.clip(2 * source.azimuth_std, GLOW / 2, WIDEST_GLOW) if self._style.show_spread else GLOW
            reach = spread / (2 * np.pi) * self.width
            paint(GLOW_OPACITY * np.clip(1 - (distance_j / reach) ** 2, 0, None), color)
            half = max(1.0, 0.8 * self._unit)
            paint(0.45 * np.clip(2 * half + 0.5 - distance_j, 0, 1), DARK)
            paint(np.clip(half + 0.5 - distance_j, 0, 1), color)
        # Bytes times 256 fit into sixteen bits, in which pictures are mixed several times faster than in floats.
        share_jc = np.repeat(np.floor(256 * kept_j)[:, None], 3, axis=1).astype(np.uint16)
        paint_jc = np.floor(256 * added_jc).astype(np.uint16)
        touched = np.flatnonzero(kept_j < 1)
        runs = np.split(touched, np.flatnonzero(np.diff(touched) > 1) + 1) if touched.size else []
        for run in runs:
            under_ijc = picture_ijc[:, run[0] : run[-1] + 1]
            under_ijc[:] = (under_ijc * share_jc[run] + paint_jc[run]) >> 8

    def _draw_labels(
        self, picture_ijc: npt.NDArray[np.uint8], sources: Sequence[IdentifiedSource], time_s: float
    ) -> None:
        """Draws boxes along the upper edge (the ceiling), in order of names, which keeps them in place."""
        held = {source.name: source for source in self._timeline.at(time_s // LABEL_S * LABEL_S)}
        named = sorted(sources, key=lambda source: source.name)
        sprites = [self._label_sprite(held.get(source.name, source)) for source in named]
        size = BoxSize(
            max((sprite.columns for sprite in sprites), default=0), max((s.rows for s in sprites), default=0)
        )
        anchors = [(self._canvas.column(source.azimuth), 0.0) for source in named]
        boxes = place_boxes(anchors, self._canvas, size)
        for sprite, box in zip(sprites, boxes, strict=True):
            for x in box.centers:
                sprite.draw_onto(picture_ijc, x, box.y)

    def _label_sprite(self, source: IdentifiedSource) -> Sprite:
        spread = f" ±{np.rad2deg(source.azimuth_std):.0f}°" if self._style.show_spread else ""
        color = self._colors[source.name]
        return self._sprite(f"{source.name}: {source.level:.2f}{spread}", color, self._draw_label)

    def _draw_label(self, text: str, color: Color) -> Sprite:
        """Renders text in a box of the source's color with a dark edge."""
        mask_ij, edge = self._label.mask(text), max(1, round(self._unit))
        rows, columns = mask_ij.shape[0] + round(5 * self._unit), mask_ij.shape[1] + round(14 * self._unit)
        sprite = Sprite(rows + 2 * edge, columns + 2 * edge)
        sprite.paint(rounded_box(sprite.rows, sprite.columns, 5 * self._unit), DARK)
        sprite.paint(rounded_box(rows, columns, 4 * self._unit), color)
        sprite.paint(mask_ij, INK[ink_on(color)])
        return sprite

    def _draw_clock(self, picture_ijc: npt.NDArray[np.uint8], time_s: float) -> None:
        sprite = self._sprite(time_code(time_s), INK["white"], self._draw_time)
        margin = 8 * self._unit
        sprite.draw_onto(picture_ijc, margin + sprite.columns / 2, self._picture_rows - margin - sprite.rows / 2)

    def _draw_time(self, text: str, color: Color) -> Sprite:
        mask_ij = self._clock.mask(text)
        sprite = Sprite(mask_ij.shape[0] + round(4 * self._unit), mask_ij.shape[1] + round(12 * self._unit))
        sprite.paint(rounded_box(sprite.rows, sprite.columns, 4 * self._unit), DARK, 0.6)
        sprite.paint(mask_ij, color)
        return sprite

    def _sprite(self, text: str, color: Color, draw: Callable[[str, Color], Sprite]) -> Sprite:
        """Returns the cached sprite of a text, drawn by ``draw`` on first use."""
        if len(self._sprites) >= MAX_SPRITES:
            self._sprites.clear()
        if (text, color) not in self._sprites:
            self._sprites[text, color] = draw(text, color)
        return self._sprites[text, color]


def time_code(time_s: float) -> str:
    """Formats a time as minutes, seconds and tenths, with hours if there are any."""
    tenths = max(0, int(time_s * 10 + 1e-6))
    minutes, seconds = divmod(tenths / 10, 60)
    hours, minutes = divmod(int(minutes), 60)
    return f"{hours}:{minutes:02d}:{seconds:04.1f}" if hours else f"{minutes}:{seconds:04.1f}"

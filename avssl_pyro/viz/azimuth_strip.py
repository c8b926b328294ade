"""Strip below an annotated picture: mixing levels over azimuth, and trails of the last seconds."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.tracking.timeline import MAX_TURN, IdentifiedSource, Timeline
from avssl_pyro.viz.palette import Color
from avssl_pyro.viz.panorama_axes import PanoramaAxes
from avssl_pyro.viz.sprites import TextRenderer

TRAIL_S = 6.0
BACKGROUND: Color = (0.09, 0.1, 0.12)
WHITE: Color = (1.0, 1.0, 1.0)
# OpenCV takes coordinates with this many binary places.
PLACES = 4
# Heights of the strip's parts in units of 1/1152 of its width, from above.
HEADROOM, LEVELS, RULER, TRAIL, FOOT = 8, 56, 28, 34, 3


@dataclass(frozen=True)
class _Step:
    """Path of a source between two frames of the timeline; columns exceed the width where it crosses the seam."""

    start_s: float
    end_s: float
    start: float
    end: float
    color: Color


def _steps(timeline: Timeline, canvas: PanoramaAxes, colors: Mapping[int, Color]) -> Iterator[_Step]:
    """Yields paths in order of their start; a source that ends or jumps stays for half a hop."""
    moments = timeline.frames
    for moment, following in zip(moments, (*moments[1:], None), strict=True):
        later = {source.name: source for source in following.sources} if following is not None else {}
        for source in moment.sources:
            x = canvas.column(source.azimuth)
            goal = later.get(source.name)
            turn = math.remainder(canvas.column(goal.azimuth) - x, canvas.width) if goal is not None else math.inf
            if following is None or abs(turn) > MAX_TURN / (2 * math.pi) * canvas.width:
                yield _Step(moment.time_s, moment.time_s + timeline.hop_s / 2, x, x, colors[source.name])
            else:
                yield _Step(moment.time_s, following.time_s, x, x + turn, colors[source.name])


class AzimuthStrip:
    """Draws the strip below a picture, with every source below its column.

    The height of a bar is the mixing level, up to the line at level 1; a bar at the seam appears at both edges. Below
    the ruler time runs downwards, from now at the top to six seconds ago at the bottom.

    Args:
        canvas: geometry of the picture above.
        timeline: sources over time.
        colors: color of each source, by name.
        show_spread: True draws two standard deviations either way as a line below the bar.
    """

    def __init__(
        self, canvas: PanoramaAxes, timeline: Timeline, colors: Mapping[int, Color], show_spread: bool
    ) -> None:
        self._canvas = canvas
        self._colors = colors
        self._steps = tuple(_steps(timeline, canvas, colors))
        self._show_spread = show_spread
        self._unit = canvas.width / 1152
        self._floor = self._rows(HEADROOM + LEVELS)
        self._ceiling = self._rows(HEADROOM)
        self._trail_top = self._rows(HEADROOM + LEVELS + RULER)
        self._trail_rows = self._rows(TRAIL)
        height = self._rows(HEADROOM + LEVELS + RULER + TRAIL + FOOT)
        self._empty_ijc = np.empty((height, canvas.width, 3), dtype=np.uint8)
        self._empty_ijc[:] = _bytes(BACKGROUND)
        self._draw_ruler()

    @property
    def height(self) -> int:
        return len(self._empty_ijc)

    def draw(self, strip_ijc: npt.NDArray[np.uint8], time_s: float, sources: Sequence[IdentifiedSource]) -> None:
        """Draws the strip at a time into ``strip_ijc``, uint8 RGB (height, width, 3)."""
        strip_ijc[:] = self._empty_ijc
        self._draw_trails(strip_ijc, time_s)
        for source in sources:
            self._draw_bar(strip_ijc, source, self._colors[source.name])

    def _rows(self, units: float) -> int:
        return round(units * self._unit)

    def _draw_ruler(self) -> None:
        """Draws ticks every ten degrees, labels every thirty, and lines at levels 1/2 and 1."""
        picture_ijc, canvas, unit = self._empty_ijc, self._canvas, self._unit
        small = TextRenderer(13 * unit)
        for row, share in ((self._ceiling, 0.12), (round((self._ceiling + self._floor) / 2), 0.08)):
            picture_ijc[row] = _bytes(_mixed(WHITE, share))
        thick = max(1, round(unit))
        for degrees in range(-180, 180, 10):
            x = canvas.column(np.deg2rad(degrees))
            labelled = degrees % 30 == 0
            length = self._rows(8 if labelled else 4)
            for shift in canvas.copies(x - thick, x + thick):
                # The small offset makes equal fractions round the same way.
                left = int(np.clip(round(x + shift - thick / 2 + 1e-6), 0, canvas.width - thick))
                picture_ijc[self._floor : self._floor + length, left : left + thick] = _bytes(_mixed(WHITE, 0.8))
            if labelled:
                self._draw_degrees(small, degrees, x)
        caption = TextRenderer(10.5 * unit)
        for text, top in (("level 1", self._ceiling), (f"last {TRAIL_S:g} s", self._trail_top)):
            sprite = caption.sprite(text, WHITE, 0.45)
            sprite.draw_onto(picture_ijc, 6 * unit + sprite.columns / 2, top + 2 * unit + sprite.rows / 2)

    def _draw_degrees(self, text_renderer: TextRenderer, degrees: int, x: float) -> None:
        """Draws the label of a tick, whole at both edges if it crosses the seam."""
        text = {0: "0°", -180: "±180°"}.get(degrees, f"{degrees:+d}°".replace("-", "−"))
        sprite = text_renderer.sprite(text, WHITE, 0.9)
        half = sprite.columns / 2 + 4 * self._unit
        for shift in self._canvas.copies(x - half, x + half):
            middle = float(np.clip(x + shift, half, self._canvas.width - half))
            sprite.draw_onto(self._empty_ijc, middle, self._floor + 9 * self._unit + sprite.rows / 2)

    def _draw_bar(self, strip_ijc: npt.NDArray[np.uint8], source: IdentifiedSource, color: Color) -> None:
        canvas, unit = self._canvas, self._unit
        x, half = canvas.column(source.azimuth), 5.5 * unit
        top = self._floor - max(2 * unit, min(source.level, 1.0) * (self._floor - self._ceiling))
        pointer = 6 * unit
        for shift in canvas.copies(x - pointer, x + pointer):
            middle = x + shift
            _fill(
                strip_ijc,
                (
                    (middle - half, top),
                    (middle + half, top),
                    (middle + half, self._floor),
                    (middle - half, self._floor),
                ),
                color,
            )
            # The picture's line ends in a pointer at the upper edge.
            _fill(strip_ijc, ((middle - pointer, 0), (middle + pointer, 0), (middle, 1.2 * pointer)), color)
        if self._show_spread:
            reach = min(2 * source.azimuth_std / (2 * np.pi), 0.5) * canvas.width
            thick = max(1.5, 3 * unit)
            for shift in canvas.copies(x - reach, x + reach):
                left, right = x + shift - reach, x + shift + reach
                low = self._floor + thick
                _fill(strip_ijc, ((left, self._floor), (right, self._floor), (right, low), (left, low)), color)

    def _draw_trails(self, strip_ijc: npt.NDArray[np.uint8], time_s: float) -> None:
        """Draws the fading paths of the last seconds, with gaps where a source is missing or jumps."""
        first = bisect_left(self._steps, time_s - TRAIL_S, key=lambda step: step.start_s)
        last = bisect_right(self._steps, time_s, key=lambda step: step.start_s)
        thick = max(1, round(2.4 * self._unit))
        for step in self._steps[first:last]:
            age = (time_s - step.start_s) / TRAIL_S
            end_s = min(step.end_s, time_s)
            end = step.start + (step.end - step.start) * (end_s - step.start_s) / (step.end_s - step.start_s)
            y, end_y = (
                self._trail_top + (time_s - then) / TRAIL_S * self._trail_rows for then in (step.start_s, end_s)
            )
            faded = _bytes(_mixed(step.color, 1 - 0.85 * age))
            for shift in self._canvas.copies(min(step.start, end) - thick, max(step.start, end) + thick):
                points = _fixed(step.start + shift, y), _fixed(end + shift, end_y)
                cv2.line(strip_ijc, *points, faded, thick, cv2.LINE_AA, PLACES)


def _mixed(color: Color, share: float) -> Color:
    """Blends a color over the strip's background."""
    red, green, blue = (share * part + (1 - share) * under for part, under in zip(color, BACKGROUND, strict=True))
    return red, green, blue


def _bytes(color: Color) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in color)
    return red, green, blue


def _fixed(x: float, y: float) -> tuple[int, int]:
    """Converts a point to OpenCV's fixed-point numbers, whose integers are centres of pixels."""
    return round((x - 0.5) * (1 << PLACES)), round((y - 0.5) * (1 << PLACES))


def _fill(picture_ijc: npt.NDArray[np.uint8], corners: Sequence[tuple[float, float]], color: Color) -> None:
    points = np.asarray([_fixed(x, y) for x, y in corners], dtype=np.int32)
    cv2.fillConvexPoly(picture_ijc, points, _bytes(color), cv2.LINE_AA, PLACES)

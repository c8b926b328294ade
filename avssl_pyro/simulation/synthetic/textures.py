"""Textures of synthetic rooms: walls with windows, doors and pictures, floors and ceilings."""

from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.simulation.synthetic.people import random_color

PX_PER_M = 64

Rgb255 = tuple[float, ...]  # red, green, blue, 0-255
Texture = npt.NDArray[np.uint8]


def draw_wall(rng: np.random.Generator, width_m: float, height_m: float, base: Rgb255, trim: Rgb255) -> Texture:
    """Draws a wall as seen from inside, RGB, 64 pixels a metre."""
    wall = _plain(height_m, width_m, base)
    if rng.uniform() < 0.3:
        _stripes(wall, rng, base, axis=1)
    if rng.uniform() < 0.3:
        panel = _px(height_m - rng.uniform(0.8, 1.2))
        cv2.rectangle(wall, (0, panel), (wall.shape[1], wall.shape[0]), trim, -1)
    _mottle(wall, rng)
    # Objects follow each other along the wall without overlap.
    left = float(rng.uniform(0.1, 0.6))
    while left < width_m - 0.6:
        furnish, breadth = _OBJECTS[int(rng.integers(len(_OBJECTS)))]
        span = float(rng.uniform(*breadth))
        if left + span < width_m - 0.1:
            furnish(wall, rng, left, span, height_m)
        left += span + float(rng.uniform(0.2, 1.2))
    skirting = _px(0.1)
    wall[-skirting:] = np.clip(0.8 * np.array(trim), 0, 255).astype(np.uint8)
    return wall


def draw_floor(rng: np.random.Generator, length_m: float, width_m: float) -> Texture:
    """Draws a floor of planks, tiles or carpet, perhaps with a rug; x upwards, y to the left."""
    base = random_color(rng, (0.1, 0.6), (0.25, 0.8))
    floor = _plain(length_m, width_m, base)
    kind = rng.uniform()
    if kind < 0.45:
        _stripes(floor, rng, base, axis=int(rng.integers(2)))
    elif kind < 0.75:
        tile = _px(float(rng.uniform(0.3, 0.7)))
        line = tuple(0.75 * channel for channel in base)
        for offset in range(0, max(floor.shape[:2]), tile):
            cv2.line(floor, (offset, 0), (offset, floor.shape[0]), line, 2)
            cv2.line(floor, (0, offset), (floor.shape[1], offset), line, 2)
    if rng.uniform() < 0.4:
        center = (floor.shape[1] // 2 + int(rng.integers(-60, 60)), floor.shape[0] // 2 + int(rng.integers(-60, 60)))
        size = (int(rng.integers(40, 110)), int(rng.integers(40, 110)))
        for shrink in (1.0, 0.85):
            axes = (round(size[0] * shrink), round(size[1] * shrink))
            cv2.ellipse(floor, center, axes, 0, 0, 360, random_color(rng, (0.2, 0.8), (0.3, 0.9)), -1, cv2.LINE_AA)
    _mottle(floor, rng)
    return floor


def draw_ceiling(rng: np.random.Generator, length_m: float, width_m: float) -> Texture:
    """Draws a ceiling with lamps; x upwards, y to the left."""
    ceiling = _plain(length_m, width_m, random_color(rng, (0.0, 0.12), (0.75, 1.0)))
    lamps = int(rng.integers(1, 4))
    for x in np.linspace(0, width_m, lamps + 2)[1:-1]:
        for y in np.linspace(0, length_m, lamps + 2)[1:-1]:
            cv2.circle(ceiling, (_px(x), _px(y)), _px(float(rng.uniform(0.1, 0.2))), (255, 252, 240), -1, cv2.LINE_AA)
    _mottle(ceiling, rng)
    return ceiling


def _px(metres: float) -> int:
    return round(metres * PX_PER_M)


def _plain(rows_m: float, columns_m: float, color: Rgb255) -> Texture:
    texture = np.empty((_px(rows_m), _px(columns_m), 3), dtype=np.uint8)
    cv2.rectangle(texture, (0, 0), (texture.shape[1], texture.shape[0]), color, -1)
    return texture


def _stripes(texture: Texture, rng: np.random.Generator, base: Rgb255, axis: int) -> None:
    period = int(rng.integers(6, 24))
    count = texture.shape[axis] // period + 1
    gains = rng.uniform(0.85, 1.1, count)[np.arange(texture.shape[axis]) // period]
    colors = np.clip(gains[:, None] * np.array(base), 0, 255).astype(np.uint8)
    texture[:] = colors[None] if axis == 1 else colors[:, None]


def _mottle(texture: Texture, rng: np.random.Generator) -> None:
    rows, columns = texture.shape[:2]
    coarse = rng.normal(1.0, 0.05, (max(rows // 24, 2), max(columns // 24, 2))).astype(np.float32)
    gain = cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_CUBIC)
    texture[:] = cv2.convertScaleAbs(cv2.multiply(texture, cv2.merge([gain] * 3), dtype=cv2.CV_32F))


def _rectangle(wall: Texture, box_m: tuple[float, float, float, float], color: Rgb255, border: int = -1) -> None:
    left, top, right, bottom = (_px(value) for value in box_m)
    cv2.rectangle(wall, (left, top), (right, bottom), color, border)


def _window(wall: Texture, rng: np.random.Generator, left: float, span: float, height_m: float) -> None:
    top, bottom = max(height_m - float(rng.uniform(2.0, 2.5)), 0.0), height_m - float(rng.uniform(0.7, 1.1))
    sky = np.linspace(float(rng.uniform(0.8, 1.0)), float(rng.uniform(0.5, 0.8)), _px(bottom) - _px(top))
    color = np.array(random_color(rng, (0.05, 0.35), (0.7, 1.0)))
    wall[_px(top) : _px(bottom), _px(left) : _px(left + span)] = (sky[:, None, None] * color).astype(np.uint8)
    if rng.uniform() < 0.6:
        ground = bottom - float(rng.uniform(0.2, 0.6))
        _rectangle(wall, (left, ground, left + span, bottom), random_color(rng, (0.2, 0.6), (0.2, 0.6)))
    frame = random_color(rng, (0.0, 0.3), (0.3, 1.0))
    _rectangle(wall, (left, top, left + span, bottom), frame, 5)
    for bar in range(1, int(rng.integers(2, 4))):
        x = left + span * bar / 2
        _rectangle(wall, (min(x, left + span), top, min(x, left + span), bottom), frame, 3)


def _door(wall: Texture, rng: np.random.Generator, left: float, span: float, height_m: float) -> None:
    color = random_color(rng, (0.0, 0.6), (0.2, 0.95))
    top = height_m - 2.05
    _rectangle(wall, (left, top, left + span, height_m), color)
    dark = tuple(0.7 * channel for channel in color)
    _rectangle(wall, (left, top, left + span, height_m), dark, 4)
    for panel in (0.15, 1.1):
        _rectangle(wall, (left + 0.15, top + panel, left + span - 0.15, top + panel + 0.75), dark, 2)
    cv2.circle(wall, (_px(left + span - 0.08), _px(height_m - 1.0)), 3, (210, 200, 150), -1, cv2.LINE_AA)


def _picture(wall: Texture, rng: np.random.Generator, left: float, span: float, height_m: float) -> None:
    top = height_m - float(rng.uniform(1.7, 2.1))
    bottom = top + float(rng.uniform(0.4, 0.9))
    _rectangle(wall, (left, top, left + span, bottom), random_color(rng, (0.0, 0.7), (0.3, 1.0)))
    for _ in range(int(rng.integers(1, 5))):
        center = (_px(left + span * rng.uniform(0.2, 0.8)), _px(top + (bottom - top) * rng.uniform(0.2, 0.8)))
        radius = int(rng.integers(3, max(4, _px(min(span, bottom - top)) // 3)))
        cv2.circle(wall, center, radius, random_color(rng, (0.2, 1.0), (0.2, 1.0)), -1, cv2.LINE_AA)
    _rectangle(wall, (left, top, left + span, bottom), random_color(rng, (0.0, 0.6), (0.05, 0.5)), 3)


def _shelf(wall: Texture, rng: np.random.Generator, left: float, span: float, height_m: float) -> None:
    wood = random_color(rng, (0.3, 0.6), (0.3, 0.7))
    for level in range(int(rng.integers(1, 4))):
        board = height_m - 1.2 - 0.4 * level
        _rectangle(wall, (left, board, left + span, board + 0.04), wood)
        x = left
        while x < left + span - 0.08:
            thick = float(rng.uniform(0.02, 0.08))
            if rng.uniform() < 0.75:
                book = (x, board - float(rng.uniform(0.15, 0.3)), x + thick - 0.02, board)
                _rectangle(wall, book, random_color(rng, (0.1, 0.9), (0.15, 0.95)))
            x += thick


def _curtain(wall: Texture, rng: np.random.Generator, left: float, span: float, height_m: float) -> None:
    color = np.array(random_color(rng, (0.0, 0.7), (0.3, 0.95)))
    columns = wall[_px(max(height_m - 2.6, 0.0)) : _px(height_m - 0.05), _px(left) : _px(left + span)]
    folds = 0.85 + 0.15 * np.sin(np.arange(columns.shape[1]) * float(rng.uniform(0.3, 0.8)))
    columns[:] = np.clip(folds[None, :, None] * color, 0, 255).astype(np.uint8)


_Furnish = Callable[[Texture, np.random.Generator, float, float, float], None]
_OBJECTS: tuple[tuple[_Furnish, tuple[float, float]], ...] = (
    (_window, (0.8, 2.0)),
    (_door, (0.8, 1.0)),
    (_picture, (0.3, 1.0)),
    (_picture, (0.3, 1.0)),
    (_shelf, (0.6, 1.4)),
    (_curtain, (0.4, 1.0)),
)

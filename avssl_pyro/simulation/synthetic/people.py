"""Synthetic people: cartoon figures drawn in code, without photographs."""

import colorsys
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

ROWS, COLUMNS = 512, 288
SKIN_RGB = np.array([[255, 219, 190], [234, 190, 155], [198, 146, 106], [150, 102, 68], [98, 64, 42]], dtype=np.float64)
HAIR_RGB = np.array([[30, 24, 20], [74, 48, 30], [120, 78, 40], [196, 158, 92], [150, 145, 140], [110, 40, 24]])

Rgb255 = tuple[float, ...]  # red, green, blue, 0-255
RgbaImage = npt.NDArray[np.uint8]


def random_color(rng: np.random.Generator, saturation: tuple[float, float], value: tuple[float, float]) -> Rgb255:
    """Draws an RGB color (0-255) of any hue within ranges of saturation and value (0-1)."""
    rgb = colorsys.hsv_to_rgb(float(rng.uniform()), float(rng.uniform(*saturation)), float(rng.uniform(*value)))
    return (255 * rgb[0], 255 * rgb[1], 255 * rgb[2])


@dataclass(frozen=True)
class ProceduralPerson:
    """Cartoon people of random build, pose, skin, hair and clothes, from the front, the back or the side."""

    @property
    def name(self) -> str:
        return "procedural"

    def describe(self) -> str:
        return "people drawn in code"

    def draw(self, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
        canvas = np.zeros((ROWS, COLUMNS, 4), dtype=np.uint8)
        build = float(rng.uniform(0.82, 1.3))
        tone = rng.uniform(0, len(SKIN_RGB) - 1)
        low = int(tone)
        skin = tuple(SKIN_RGB[low] + (tone - low) * (SKIN_RGB[min(low + 1, len(SKIN_RGB) - 1)] - SKIN_RGB[low]))
        top = random_color(rng, (0.0, 0.9), (0.2, 1.0))
        bottom = random_color(rng, (0.0, 0.6), (0.1, 0.7))
        is_long = bool(rng.uniform() < 0.25)
        hair = tuple(HAIR_RGB[int(rng.integers(len(HAIR_RGB)))] * float(rng.uniform(0.7, 1.2)))
        if rng.uniform() < 0.4:  # long hair falls behind the shoulders
            _disc(canvas, COLUMNS / 2, float(rng.uniform(48, 66)), 31, float(rng.uniform(44, 60)), hair)
        _legs(canvas, rng, build, skin if is_long else bottom, random_color(rng, (0.0, 0.5), (0.05, 0.6)))
        if is_long:
            _skirt(canvas, rng, build, bottom)
        _torso(canvas, rng, build, top)
        _arms(canvas, rng, build, top if rng.uniform() < 0.6 else skin, skin)
        _head(canvas, rng, skin, hair)
        # The edges blend from a black, empty canvas; halving the drawing keeps that rim below half a pixel.
        small = np.asarray(cv2.resize(canvas, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        _shade(small, rng)
        rows = np.flatnonzero((small[..., 3] > 32).any(axis=1))
        columns = np.flatnonzero((small[..., 3] > 32).any(axis=0))
        return np.ascontiguousarray(small[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1])


def _fill(canvas: RgbaImage, points: list[tuple[float, float]], color: Rgb255) -> None:
    polygon = np.round(np.array(points) * 16).astype(np.int32)
    cv2.fillPoly(canvas, [polygon], (*color, 255), lineType=cv2.LINE_AA, shift=4)


def _limb(canvas: RgbaImage, joints: list[tuple[float, float]], widths: tuple[float, ...], color: Rgb255) -> None:
    for (x0, y0), (x1, y1), w0, w1 in zip(joints, joints[1:], widths, widths[1:], strict=False):
        length = max(float(np.hypot(x1 - x0, y1 - y0)), 1e-6)
        nx, ny = -(y1 - y0) / length, (x1 - x0) / length
        corners = [
            (x0 + nx * w0, y0 + ny * w0),
            (x1 + nx * w1, y1 + ny * w1),
            (x1 - nx * w1, y1 - ny * w1),
            (x0 - nx * w0, y0 - ny * w0),
        ]
        _fill(canvas, corners, color)
        for (x, y), w in (((x0, y0), w0), ((x1, y1), w1)):
            _disc(canvas, x, y, w, w, color)


def _disc(canvas: RgbaImage, x: float, y: float, rx: float, ry: float, color: Rgb255) -> None:
    center, axes = (round(x * 16), round(y * 16)), (round(rx * 16), round(ry * 16))
    cv2.ellipse(canvas, center, axes, 0, 0, 360, (*color, 255), -1, cv2.LINE_AA, 4)


def _legs(canvas: RgbaImage, rng: np.random.Generator, build: float, color: Rgb255, shoe: Rgb255) -> None:
    middle = COLUMNS / 2
    stance = float(rng.uniform(10, 26))
    for side in (-1, 1):
        hip = (middle + side * 17 * build, 262.0)
        foot = (middle + side * stance + float(rng.uniform(-5, 5)), 494.0)
        knee = ((hip[0] + foot[0]) / 2 + side * float(rng.uniform(-4, 7)), 378.0)
        _limb(canvas, [hip, knee, foot], (21 * build, 15 * build, 10 * build), color)
        turn = side * float(rng.uniform(-2, 10))
        _disc(canvas, foot[0] + turn, 501, 15 + abs(turn) / 2, 9, shoe)


def _skirt(canvas: RgbaImage, rng: np.random.Generator, build: float, color: Rgb255) -> None:
    middle, hem, flare = COLUMNS / 2, float(rng.uniform(340, 450)), float(rng.uniform(36, 62)) * build
    waist = 30 * build
    _fill(canvas, [(middle - waist, 215), (middle + waist, 215), (middle + flare, hem), (middle - flare, hem)], color)


def _torso(canvas: RgbaImage, rng: np.random.Generator, build: float, color: Rgb255) -> None:
    middle = COLUMNS / 2
    shoulder, waist, hip = 48 * build, float(rng.uniform(28, 38)) * build, 38 * build
    hem = float(rng.uniform(262, 300))
    outline = [
        (middle - shoulder * 0.35, 84.0),
        (middle + shoulder * 0.35, 84.0),
        (middle + shoulder, 100.0),
        (middle + shoulder * 0.9, 150.0),
        (middle + waist, 205.0),
        (middle + hip, hem),
        (middle - hip, hem),
        (middle - waist, 205.0),
        (middle - shoulder * 0.9, 150.0),
        (middle - shoulder, 100.0),
    ]
    _fill(canvas, outline, color)
    mark = random_color(rng, (0.0, 0.9), (0.1, 1.0))
    inside_ij = np.zeros((ROWS, COLUMNS), dtype=np.uint8)
    cv2.fillPoly(inside_ij, [np.array(outline).astype(np.int32)], 1)
    stripes = np.zeros((ROWS, COLUMNS), dtype=bool)
    pattern = rng.uniform()
    period = int(rng.integers(14, 36))
    if pattern < 0.2:
        stripes[(np.arange(ROWS) % period) < period // 3] = True
    elif pattern < 0.3:
        stripes[:, (np.arange(COLUMNS) % period) < period // 3] = True
    elif pattern < 0.5:  # an open jacket
        stripes[84:, int(middle - 9 * build) : int(middle + 9 * build)] = True
    elif pattern < 0.65:  # a print
        stripes[125:170, int(middle - 18 * build) : int(middle + 18 * build)] = True
    canvas[stripes & (inside_ij > 0), :3] = np.round(mark)


def _arms(canvas: RgbaImage, rng: np.random.Generator, build: float, sleeve: Rgb255, skin: Rgb255) -> None:
    middle = COLUMNS / 2
    for side in (-1, 1):
        shoulder = (middle + side * 43 * build, 108.0)
        swing, bend = np.deg2rad(rng.uniform(2, 24)), np.deg2rad(rng.normal(0, 18))
        if rng.uniform() < 0.15:  # gesturing
            bend = np.deg2rad(rng.uniform(70, 150))
        elbow = (shoulder[0] + side * 78 * np.sin(swing), shoulder[1] + 78 * np.cos(swing))
        wrist = (elbow[0] + side * 68 * np.sin(swing + bend), elbow[1] + 68 * np.cos(swing + bend))
        _limb(canvas, [shoulder, elbow, wrist], (13 * build, 11 * build, 7.5 * build), sleeve)
        _disc(canvas, wrist[0], wrist[1] + 5, 8, 11, skin)


def _head(canvas: RgbaImage, rng: np.random.Generator, skin: Rgb255, hair: Rgb255) -> None:
    x, y = COLUMNS / 2 + float(rng.uniform(-3, 3)), 42.0
    facing = float(rng.uniform(-1.4, 1.4))
    _limb(canvas, [(x, 60.0), (x, 92.0)], (12.0, 14.0), tuple(0.88 * channel for channel in skin))
    _disc(canvas, x, y, 25, 33, skin)
    if rng.uniform() < 0.25:  # seen from behind
        _disc(canvas, x, y - 2, 27, 34, hair)
        return
    dark: Rgb255 = (50.0, 36.0, 34.0)
    for eye in (-1, 1):
        _disc(canvas, x + 9 * eye + 9 * facing, y - 1, 3.4, 2.2, dark)
    _disc(canvas, x + 10 * facing, y + 9, 2.5, 4, tuple(0.85 * channel for channel in skin))
    _disc(canvas, x + 9 * facing, y + 19, 7, float(rng.uniform(1.5, 4)), (150.0, 60.0, 60.0))
    if rng.uniform() < 0.93:
        cap = 1.0 - 0.25 * float(rng.uniform())
        cv2.ellipse(
            canvas,
            (round(x - 3 * facing), round(y - 4)),
            (27, round(33 * cap)),
            0,
            175,
            365,
            (*hair, 255),
            -1,
            cv2.LINE_AA,
        )


def _shade(canvas: RgbaImage, rng: np.random.Generator) -> None:
    """Shades the figure by light from one side and from above."""
    rows, columns = canvas.shape[:2]
    alpha_ij = canvas[..., 3].astype(np.float32) / 255
    soft_ij = cv2.GaussianBlur(alpha_ij, (0, 0), 4.5)
    side = float(rng.uniform(-0.35, 0.35))
    light_j = 1.0 + side * np.linspace(-1, 1, columns, dtype=np.float32)
    light_ij = light_j * (0.55 + 0.45 * soft_ij) * np.linspace(1.06, 0.88, rows, dtype=np.float32)[:, None]
    grain_ij = rng.normal(1.0, 0.02, (rows // 2, columns // 2)).astype(np.float32)
    light_ij = light_ij * cv2.resize(grain_ij, (columns, rows))
    canvas[..., :3] = np.clip(canvas[..., :3] * light_ij[..., None], 0, 255)

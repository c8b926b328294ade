"""Overlay of a localized clip: activation, mixing level and azimuth of each class (the paper's Fig. 5)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Polygon

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.io.images import save_png
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource
from avssl_pyro.viz.activation import blend_class_colors, desaturate, resize_circular, strength_maps
from avssl_pyro.viz.palette import OKABE_ITO, Color, color_of, ink_on
from avssl_pyro.viz.panorama_axes import MIN_WIDTH, BoxSize, LabelBox, PanoramaAxes, place_boxes

DPI = 100
# A rejected class is faint; it needs a direction of this weight, this far from all sources (radians).
REJECTED_EMPHASIS, REJECTED_MIN_WEIGHT, REJECTED_DISTANCE = 0.4, 0.1, np.deg2rad(15.0)
REJECTED = "\N{MULTIPLICATION SIGN}"


@dataclass(frozen=True)
class _Mark:
    """One labelled class: a source, or a class with a pronounced direction that was rejected."""

    source_class: int
    azimuth: float
    level: float
    row: float
    color: Color
    source: LocalizedSource | None


def _peak_row(strength_ij: npt.NDArray[np.float32], azimuth: float) -> float:
    """Returns the row of the strongest activation within 10 degrees of an azimuth; for bands the middle."""
    rows, columns = strength_ij.shape
    column = PanoramaAxes(columns, rows).column(azimuth)
    reach = max(1, round(columns * 10 / 360))
    near = (round(column) + np.arange(-reach, reach + 1)) % columns
    window_ij = strength_ij[:, near]
    if np.ptp(window_ij.max(axis=1)) < 1e-6:
        return float(rows) / 2
    return float(int(window_ij.argmax()) // window_ij.shape[1])


def _marks(
    posterior: ClipPosterior,
    sources: Sequence[LocalizedSource],
    grid: DirectionGrid,
    strength_kij: npt.NDArray[np.float32],
    colors: Sequence[Color],
) -> list[_Mark]:
    """Returns marks of all sources, and of other classes with a pronounced direction away from them."""

    def mark(k: int, azimuth: float, level: float, source: LocalizedSource | None) -> _Mark:
        return _Mark(k, azimuth, level, _peak_row(strength_kij[k], azimuth), colors[k], source)

    marks = [mark(source.source_class, source.azimuth, source.level, source) for source in sources]
    shown = {k for source in sources for k in source.classes}
    for k, weights_d in enumerate(posterior.direction_weights_kd):
        azimuth = float(grid.azimuths[int(weights_d.argmax())])
        apart = all(abs(float(wrap_angle(azimuth - other.azimuth))) > REJECTED_DISTANCE for other in marks)
        if k not in shown and apart and float(weights_d.max()) >= REJECTED_MIN_WEIGHT:
            shown.add(k)
            marks.append(mark(k, azimuth, float(posterior.mixing_levels_k[k]), None))
    return marks


def _draw_box(ax: Axes, unit: float, mark: _Mark, box: LabelBox, size: BoxSize) -> None:
    """Draws a box: filled with the level for a source, hollow with a cross for a rejected class."""
    filled = mark.source is not None
    for x in box.centers:
        ax.add_patch(
            FancyBboxPatch(
                (x - size.width / 2, box.y - size.height / 2),
                size.width,
                size.height,
                boxstyle=f"round,pad=0,rounding_size={5 * unit}",
                facecolor=mark.color if filled else (0.08, 0.09, 0.1, 0.7),
                edgecolor=(0.05, 0.05, 0.05) if filled else mark.color,
                linewidth=1.1 * unit,
                zorder=6,
            )
        )
        ax.text(
            x,
            # The font's digits are a little above the middle of the line.
            box.y + unit,
            f"{mark.level:.2f}" if filled else REJECTED,
            color=ink_on(mark.color) if filled else "white",
            weight="bold" if filled else "normal",
            fontsize=11 * unit,
            ha="center",
            va="center",
            zorder=7,
        )


def _draw_direction(ax: Axes, canvas: PanoramaAxes, mark: _Mark) -> None:
    """Draws a line at the azimuth, and on the ruler two standard deviations either way and a pointer."""
    unit, x, top = canvas.unit, canvas.column(mark.azimuth), float(canvas.image_height)
    source = mark.source
    margin = 8 * unit
    for shift in canvas.copies(x - margin, x + margin):
        xs, ys = (x + shift, x + shift), (0.0, top)
        if source is None:
            ax.plot(xs, ys, color=mark.color, linewidth=1.0 * unit, linestyle=(0, (2, 4)), alpha=0.7, zorder=3)
        else:
            ax.plot(xs, ys, color="black", linewidth=3.2 * unit, alpha=0.45, zorder=3)
            ax.plot(xs, ys, color=mark.color, linewidth=1.5 * unit, zorder=4)
            pointer = [(x + shift - 6 * unit, top + 9 * unit), (x + shift + 6 * unit, top + 9 * unit), (x + shift, top)]
            ax.add_patch(Polygon(pointer, closed=True, facecolor=mark.color, edgecolor="none", zorder=5))
    if source is not None:
        half = min(2 * source.azimuth_std / (2 * np.pi), 0.5) * canvas.width
        for shift in canvas.copies(x - half, x + half):
            xs = (x + shift - half, x + shift + half)
            y = top + 2 * unit
            ax.plot(xs, (y, y), color=mark.color, linewidth=3.5 * unit, solid_capstyle="butt", zorder=4)


def _draw_ruler(ax: Axes, canvas: PanoramaAxes) -> None:
    unit, top = canvas.unit, float(canvas.image_height)
    ax.axhspan(top, canvas.height, color=(0.09, 0.1, 0.12), zorder=1)
    for degrees in range(180, -181, -10):
        x = (180 - degrees) / 360 * canvas.width
        labelled = degrees % 30 == 0
        length = (8 if labelled else 4) * unit
        ax.plot((x, x), (top, top + length), color="white", linewidth=1.0 * unit, alpha=0.8, zorder=2)
        if labelled:
            align, inset = {180: ("left", 4 * unit), -180: ("right", -4 * unit)}.get(degrees, ("center", 0.0))
            text = f"{degrees:+d}°".replace("-", "−") if degrees else "0°"
            y = top + 21 * unit
            ax.text(x + inset, y, text, color="white", fontsize=9.5 * unit, ha=align, va="center", zorder=6)


def _draw_truth(ax: Axes, canvas: PanoramaAxes, truth: Sequence[float] | npt.NDArray[np.float64]) -> None:
    """Draws white triangles along the upper edge at the true azimuths."""
    unit = canvas.unit
    for azimuth in truth:
        x = canvas.column(azimuth)
        for shift in canvas.copies(x - 8 * unit, x + 8 * unit):
            corners = [(x + shift - 8 * unit, 0.0), (x + shift + 8 * unit, 0.0), (x + shift, 13 * unit)]
            ax.add_patch(
                Polygon(corners, closed=True, facecolor="white", edgecolor="black", linewidth=1.0 * unit, zorder=8)
            )


def _render(background_ijc: npt.NDArray[np.uint8], draw: Callable[[Axes], None]) -> npt.NDArray[np.uint8]:
    """Draws vector graphics in pixel coordinates over an image, off screen and without pyplot's global state."""
    height, width = background_ijc.shape[:2]
    # Slightly more than the exact size, as the figure's size is rounded down.
    figure = Figure(figsize=((width + 0.01) / DPI, (height + 0.01) / DPI), dpi=DPI)
    canvas = FigureCanvasAgg(figure)
    figure.figimage(background_ijc, zorder=-1)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set_axis_off()
    ax.set_xlim(0, width)
    ax.set_ylim(height, 0)
    draw(ax)
    canvas.draw()
    rgba_ijc = np.asarray(canvas.buffer_rgba(), dtype=np.uint8)
    return np.ascontiguousarray(rgba_ijc[..., :3])


def draw_overlay(
    image_ijc: npt.NDArray[np.uint8],
    posterior: ClipPosterior,
    sources: Sequence[LocalizedSource],
    grid: DirectionGrid,
    *,
    truth: Sequence[float] | npt.NDArray[np.float64] | None = None,
    palette: Sequence[Color] = OKABE_ITO,
) -> npt.NDArray[np.uint8]:
    """Draws a localized clip; marks that cross the seam at 180 degrees continue at the other side.

    Each source has an activation map, a line and a pointer in the color of its class, a bar of two standard deviations
    either way on the ruler, and its mixing level in a filled box. A class with a pronounced direction whose direct
    level is too low for a source is faint, with a dashed line and a cross in a hollow box: it was rejected, whatever is
    in the picture there.

    Args:
        image_ijc: image, RGB, (I, J, 3), equirectangular, left edge at +180 degrees, same view as the activations.
        posterior: posterior of the clip; without activation maps, direction weights are drawn as bands.
        sources: sources selected from the posterior.
        grid: directions of the posterior.
        truth: true azimuths, radians, drawn as white triangles along the upper edge.
        palette: colors of the classes, repeated if there are more classes.

    Returns:
        RGB, (I', J', 3): the image enlarged by a whole number to at least 1152 columns, and a ruler below it.
    """
    factor = max(1, -(-MIN_WIDTH // image_ijc.shape[1]))
    canvas = PanoramaAxes(image_ijc.shape[1] * factor, image_ijc.shape[0] * factor)
    photo_ijc = cv2.resize(image_ijc, (canvas.width, canvas.image_height), interpolation=cv2.INTER_CUBIC)
    raw_kij = strength_maps(posterior.direction_weights_kd, posterior.activations_kij)
    strength_kij = np.stack([resize_circular(raw_ij, canvas.image_height, canvas.width) for raw_ij in raw_kij])

    colors = [color_of(k, palette) for k in range(len(strength_kij))]
    marks = _marks(posterior, sources, grid, strength_kij, colors)
    emphasis = [0.0] * len(strength_kij)
    for mark in marks:
        emphasis[mark.source_class] = REJECTED_EMPHASIS if mark.source is None else 1.0
    blended_ijc = blend_class_colors(desaturate(np.asarray(photo_ijc, dtype=np.uint8)), strength_kij, colors, emphasis)
    background_ijc = np.zeros((canvas.height, canvas.width, 3), dtype=np.uint8)
    background_ijc[: canvas.image_height] = (255 * blended_ijc + 0.5).clip(0, 255).astype(np.uint8)
    size = BoxSize(46 * canvas.unit, 23 * canvas.unit)

    def draw(ax: Axes) -> None:
        _draw_ruler(ax, canvas)
        boxes = place_boxes([(canvas.column(mark.azimuth), mark.row) for mark in marks], canvas, size)
        for mark, box in zip(marks, boxes, strict=True):
            _draw_direction(ax, canvas, mark)
            _draw_box(ax, canvas.unit, mark, box, size)
        _draw_truth(ax, canvas, () if truth is None else truth)

    return _render(background_ijc, draw)


def save_overlay(
    path: Path,
    image_ijc: npt.NDArray[np.uint8],
    posterior: ClipPosterior,
    sources: Sequence[LocalizedSource],
    grid: DirectionGrid,
    *,
    truth: Sequence[float] | npt.NDArray[np.float64] | None = None,
    palette: Sequence[Color] = OKABE_ITO,
) -> None:
    """Writes the overlay of :func:`draw_overlay` as PNG.

    Raises:
        OSError: the file cannot be written; nothing is left behind.
    """
    save_png(path, draw_overlay(image_ijc, posterior, sources, grid, truth=truth, palette=palette))

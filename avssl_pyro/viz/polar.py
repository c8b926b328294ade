"""Polar plots of directions, seen from above: straight ahead is up, left is left.

A posterior is drawn as a rose, with a wedge for every direction of every class. The area of a wedge is the level of the
class times the share of the direction, so the area of a class is its level.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.clip import SceneLabels
from avssl_pyro.errors import InputError
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource
from avssl_pyro.viz.palette import OKABE_ITO, color_of

PANEL_INCHES = 2.7
# Marks beyond the largest wedge, in its radius: the rim, arcs of spread, true azimuths.
RIM, SPREAD, TRUTH = 1.32, 1.1, 1.22
INK, FAINT = "#222222", "0.55"
# The edge of a wedge is the color of its class, darker.
EDGE_SHADE = 0.6
# Lines on white want darker colors than areas do.
PATTERN_COLORS = tuple(OKABE_ITO[index] for index in (6, 1, 4, 3, 5))


@dataclass(frozen=True)
class Circle:
    """Contents of one polar plot; angles in radians.

    Args:
        weights_kd: direction weights of every class, of any scale, (K, D), directions as in :class:`DirectionGrid`.
        level_k: mixing levels, (K,); all alike by default.
        sources: localized sources, drawn as arcs of two standard deviations either way.
        talkers, silent: true azimuths of talkers and of silent people.
    """

    weights_kd: npt.ArrayLike
    level_k: npt.ArrayLike | None = None
    sources: Sequence[LocalizedSource] = ()
    talkers: Sequence[float] = ()
    silent: Sequence[float] = ()

    @classmethod
    def of(
        cls, posterior: ClipPosterior, sources: Sequence[LocalizedSource] = (), truth: SceneLabels | None = None
    ) -> "Circle":
        """Returns the plot of a posterior, its sources, and the true azimuths if known."""
        truth = truth or SceneLabels(())
        weights_kd, level_k = posterior.direction_weights_kd, posterior.mixing_levels_k
        return cls(weights_kd, level_k, sources, truth.talker_azimuths, truth.silent_azimuths)

    @property
    def radius_kd(self) -> npt.NDArray[np.float64]:
        """Radii of the wedges, (K, D): square roots of level times share.

        Raises:
            InputError: shapes do not fit, or weights or levels are negative or not finite.
        """
        weights_kd = np.asarray(self.weights_kd, dtype=np.float64)
        level_k = np.full(len(weights_kd), 1.0) if self.level_k is None else np.asarray(self.level_k, dtype=np.float64)
        if weights_kd.ndim != 2 or level_k.shape != weights_kd.shape[:1]:
            raise InputError(
                f"circle: weights of shape {weights_kd.shape} and levels of shape {level_k.shape} do not fit; "
                "give (K, D) and (K,)."
            )
        if not (np.isfinite(weights_kd).all() and (weights_kd >= 0).all() and (level_k >= 0).all()):
            raise InputError("circle: weights and levels must be finite and at least 0.")
        total_k1 = weights_kd.sum(-1, keepdims=True)
        share_kd = weights_kd / np.where(total_k1 > 0, total_k1, 1.0)
        radius_kd: npt.NDArray[np.float64] = np.sqrt(level_k[:, None] / max(level_k.sum(), 1e-300) * share_kd)
        return radius_kd


def draw_circles(circles: Mapping[str, Circle], columns: int = 4) -> Figure:
    """Roses side by side, on one scale: colors of the classes, triangles for talkers, rings for silent people.

    Args:
        circles: plots by title.
        columns: greatest number of plots in a row.

    Raises:
        InputError: there is no plot, or one has wrong values.
    """
    radii = {title: circle.radius_kd for title, circle in circles.items()}
    largest = max((float(radius_kd.max(initial=0.0)) for radius_kd in radii.values()), default=0.0) or 1.0
    figure, panels = _panels(tuple(circles), columns)
    for ax, (title, circle) in zip(panels, circles.items(), strict=True):
        radius_kd = radii[title] / largest
        grid = DirectionGrid(radius_kd.shape[-1])
        # Large wedges come first, so that none is hidden.
        for k in np.argsort(-radius_kd.max(-1)):
            color = color_of(int(k), OKABE_ITO)
            edge = tuple(EDGE_SHADE * part for part in color)
            ax.add_collection(
                PolyCollection(
                    list(_wedges(grid, radius_kd[k])),
                    facecolor=color,
                    edgecolor=edge,
                    linewidth=0.3,
                    alpha=0.85,
                    zorder=2,
                )
            )
        for source in circle.sources:
            reach = min(2 * source.azimuth_std, np.pi)
            arc = np.linspace(source.azimuth - reach, source.azimuth + reach, 64)
            color = color_of(source.source_class, OKABE_ITO)
            ax.plot(arc, np.full_like(arc, SPREAD), color=INK, linewidth=4.6, solid_capstyle="butt")
            ax.plot(arc, np.full_like(arc, SPREAD), color=color, linewidth=3.4, solid_capstyle="butt")
        _draw_truth(ax, circle.talkers, circle.silent)
        ax.set_ylim(0, RIM)
        ax.set_yticks([])
    return figure


def figure_pixels(figure: Figure, dpi: float) -> npt.NDArray[np.uint8]:
    """The pixels of a figure at a number of dots per inch, RGB, (H, W, 3)."""
    figure.set_dpi(dpi)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba(), dtype=np.uint8)[..., :3])


def draw_patterns(
    circles: Mapping[str, Mapping[str, npt.ArrayLike]], *, floor_db: float = -20.0, columns: int = 4
) -> Figure:
    """Draws powers over direction, such as beam patterns, as lines in decibels.

    Args:
        circles: plots by title, each with lines by legend; a line is a power per direction, (D,), 1 at the rim.
        floor_db: power at the middle of the circle, dB.
        columns: greatest number of plots in a row.

    Raises:
        InputError: there is no circle, or ``floor_db`` is not negative.
    """
    if not floor_db < 0:
        raise InputError(f"circle: floor_db is {floor_db}; it must be negative.")
    figure, panels = _panels(tuple(circles), columns)
    for ax, lines in zip(panels, circles.values(), strict=True):
        for index, (legend, power) in enumerate(lines.items()):
            power_d = np.asarray(power, dtype=np.float64)
            level_d = 10 * np.log10(np.maximum(power_d, 10 ** (floor_db / 10)))
            closed = np.arange(len(power_d) + 1) % len(power_d)
            azimuths_d = DirectionGrid(len(power_d)).azimuths
            ax.plot(azimuths_d[closed], level_d[closed], color=color_of(index, PATTERN_COLORS), label=legend)
        ax.set_ylim(floor_db, 1.0)
        ax.set_yticks([floor_db / 2, 0.0], [f"−{-floor_db / 2:g} dB", "0"], fontsize=6, color=FAINT)
    if len({tuple(lines) for lines in circles.values()}) == 1:
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=8)
    else:
        for ax in panels:
            ax.legend(loc="upper left", bbox_to_anchor=(0.8, 1.15), frameon=False, fontsize=7)
    return figure


def _panels(titles: Sequence[str], columns: int) -> tuple[Figure, list[PolarAxes]]:
    """Creates a figure with an empty polar plot for every title."""
    if not titles or columns < 1:
        raise InputError("circle: there is nothing to draw; give at least one circle and one column.")
    columns = min(columns, len(titles))
    rows = -(-len(titles) // columns)
    size = (PANEL_INCHES * columns, (PANEL_INCHES + 0.25) * rows)
    figure = Figure(figsize=size, dpi=110, layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False, subplot_kw={"projection": "polar"}).flat)
    for ax in axes[len(titles) :]:
        ax.set_visible(False)
    panels = [cast(PolarAxes, ax) for ax in axes[: len(titles)]]
    for ax, title in zip(panels, titles, strict=True):
        ax.set_theta_zero_location("N")
        ax.set_xticks(np.deg2rad([0, 90, 180, 270]), ["0°", "+90°", "±180°", "−90°"], fontsize=7, color=FAINT)
        ax.tick_params(pad=-1)
        ax.grid(alpha=0.3, linewidth=0.5)
        ax.spines["polar"].set_color("0.8")
        ax.set_title(title, fontsize=9, fontweight="bold")
    return figure, panels


def _wedges(grid: DirectionGrid, radius_d: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Returns the corners (azimuth, radius) of a wedge for every direction, (D, 4, 2)."""
    side_d4 = grid.azimuths[:, None] + grid.spacing / 2 * np.array([-1.0, -1.0, 1.0, 1.0])
    return np.stack([side_d4, radius_d[:, None] * np.array([0.0, 1.0, 1.0, 0.0])], axis=-1)


def _draw_truth(ax: PolarAxes, talkers: Sequence[float], silent: Sequence[float]) -> None:
    for azimuth in talkers:
        ax.plot([azimuth, azimuth], [0, TRUTH], color=INK, linewidth=0.7, linestyle=(0, (2, 3)), zorder=3)
        # A triangle that points inwards, wherever on the circle it stands.
        marker = (3, 0, float(np.rad2deg(azimuth)) + 180.0)
        ax.plot([azimuth], [TRUTH], marker=marker, color=INK, markersize=7, zorder=4)
    ax.plot(silent, [TRUTH] * len(silent), "o", markerfacecolor="white", markeredgecolor=INK, markersize=5, zorder=4)

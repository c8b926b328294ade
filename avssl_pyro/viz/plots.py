"""Plots: training curves, mixing levels, receiver operating characteristics and histograms of ranks."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy import stats

from avssl_pyro.errors import InputError
from avssl_pyro.io.images import write_png
from avssl_pyro.training.metrics_logger import read_log
from avssl_pyro.viz.palette import OKABE_ITO, color_of

NUM_COLUMNS = 3
RAW_COLOR, MEAN_COLOR = "#9bb7d4", "#0b3c6f"
FITS, DIFFERS, BAND = "#0b3c6f", "#d55e00", "0.88"
LEAST_P = 0.01
LINE_COLORS = ("#0b3c6f", "#d55e00", "#009e73", "#cc79a7")
LINE_STYLES = ("-", "--", "-.", ":")

Curve = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]
"""Shares of false alarms and of hits, from (0, 0) to (1, 1)."""


def running_mean(values: npt.NDArray[np.float64], width: int) -> npt.NDArray[np.float64]:
    """Mean over a centered window of up to ``width`` values, shorter at the ends; leaves out non-finite values."""
    finite = np.isfinite(values)
    half = max(0, (width - 1) // 2)
    total = np.concatenate([[0.0], np.cumsum(np.where(finite, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(finite)])
    index = np.arange(len(values))
    start, stop = np.maximum(index - half, 0), np.minimum(index + half + 1, len(values))
    number = count[stop] - count[start]
    return np.where(number > 0, (total[stop] - total[start]) / np.maximum(number, 1), np.nan)


def _limits(values: npt.NDArray[np.float64]) -> tuple[float, float] | None:
    """Range of the values without the few wild ones of the first steps, so that the rest can be read."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    low, high = np.quantile(finite, [0.01, 0.99])
    margin = 0.08 * (high - low) or 0.05 * max(abs(float(high)), 1e-3)
    return float(low - margin), float(high + margin)


def _draw_curve(ax: Axes, title: str, steps: npt.NDArray[np.float64], values: npt.NDArray[np.float64]) -> None:
    width = max(1, len(values) // 25)
    ax.plot(steps, values, color=RAW_COLOR, linewidth=0.7, marker="." if len(values) < 3 else "")
    ax.plot(steps, running_mean(values, width), color=MEAN_COLOR, linewidth=1.6)
    limits = _limits(values)
    if limits is None:
        ax.text(0.5, 0.5, "no finite value", transform=ax.transAxes, ha="center", va="center", color="0.4")
    else:
        ax.set_ylim(*limits)
    ax.set_title(title, fontsize=10, loc="left", fontweight="bold")
    ax.grid(alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(labelsize=8)


def save_curves(path: Path, steps: Sequence[float], series: Mapping[str, Sequence[float]]) -> None:
    """Writes training curves as PNG, one panel per series, raw values faint and a running mean on top.

    Args:
        path: image file; its folder is made if it is missing.
        steps: training step of every record.
        series: values by name, one for each record; gaps may be NaN.

    Raises:
        InputError: there is no series, or one of them is not as long as ``steps``.
        OSError: the file cannot be written; nothing is left behind.
    """
    if not series:
        raise InputError("training curves: there is no series to draw; give at least one.")
    for name, values in series.items():
        if len(values) != len(steps):
            raise InputError(
                f"training curves: '{name}' has {len(values)} values for {len(steps)} steps; give one each."
            )
    columns = min(NUM_COLUMNS, len(series))
    rows = -(-len(series) // columns)
    figure = Figure(figsize=(4.2 * columns, 2.6 * rows), dpi=110, layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for ax, (name, values) in zip(axes, series.items(), strict=False):
        _draw_curve(ax, name, np.asarray(steps, dtype=np.float64), np.asarray(values, dtype=np.float64))
    for ax in axes[len(series) :]:
        ax.set_visible(False)
    figure.supxlabel("training step", fontsize=9)
    _save(path, figure)


def save_run_curves(run_dir: Path) -> None:
    """Draws ``curves.png`` from the log of a run."""
    records = read_log(run_dir)
    if not records:
        return
    titles = {
        "elbo_gain": "ELBO per bin, above isotropic noise",
        "kl_direction_weights": "KL of direction weights, per bin",
        "kl_mixing_levels": "KL of mixing levels, per bin",
        "beta": "beta",
        "learning_rate": "learning rate",
    }
    series = {title: [record[name] for record in records] for name, title in titles.items() if name in records[-1]}
    sigmas = [name for name in records[-1] if name.startswith("sigma_")]
    series["sigma, mean over classes"] = [sum(record[name] for name in sigmas) / len(sigmas) for record in records]
    save_curves(run_dir / "curves.png", [record["step"] for record in records], series)


def draw_levels(panels: Mapping[str, npt.ArrayLike]) -> Figure:
    """Draws of mixing levels as stacked bars: a column for every draw, a color for every class.

    Args:
        panels: draws (S, K) by title, each summing to 1.

    Raises:
        InputError: there is no panel, or draws that are no (S, K).
    """
    if not panels:
        raise InputError("levels: there is no panel to draw; give at least one.")
    figure = Figure(figsize=(2.4 * len(panels), 2.2), dpi=110, layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for ax, (title, draws) in zip(axes, panels.items(), strict=True):
        level_sk = np.asarray(draws, dtype=np.float64)
        if level_sk.ndim != 2:
            raise InputError(f"levels: '{title}' has draws of shape {level_sk.shape}; give (S, K).")
        below_sk = np.cumsum(level_sk, axis=-1) - level_sk
        for k in range(level_sk.shape[-1]):
            color = color_of(k, OKABE_ITO)
            ax.bar(np.arange(len(level_sk)), level_sk[:, k], 0.85, bottom=below_sk[:, k], color=color)
        ax.set_title(title, fontsize=9, fontweight="bold")
        ax.set_xticks([])
        ax.set_ylim(0, 1)
        ax.tick_params(labelsize=7)
        ax.spines[["top", "right", "bottom"]].set_visible(False)
    axes[0].set_ylabel("mixing level", fontsize=8)
    return figure


def save_roc(path: Path, panels: Mapping[str, Mapping[str, Curve]]) -> None:
    """Writes receiver operating characteristics as PNG, one panel per array, one line per method.

    Args:
        path: image file; its folder is made if it is missing.
        panels: curves by title and legend; a panel without curves has a note.

    Raises:
        InputError: there is no panel.
        OSError: the file cannot be written; nothing is left behind.
    """
    if not panels:
        raise InputError("ROC: there is no panel to draw; give at least one.")
    figure = Figure(figsize=(3.6 * len(panels), 3.8), dpi=110, layout="constrained")
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for ax, (title, curves) in zip(axes, panels.items(), strict=True):
        ax.plot([0, 1], [0, 1], color="0.75", linewidth=0.8)
        for index, (label, (false_alarms_p, hits_p)) in enumerate(curves.items()):
            color, style = LINE_COLORS[index % len(LINE_COLORS)], LINE_STYLES[index % len(LINE_STYLES)]
            ax.plot(false_alarms_p, hits_p, style, color=color, linewidth=1.6, label=label)
        if curves:
            ax.legend(loc="lower right", fontsize=8, frameon=False)
        else:
            ax.text(0.5, 0.55, "nobody to tell apart", ha="center", va="center", color="0.4")
        ax.set_title(title, fontsize=10, loc="left", fontweight="bold")
        ax.set_aspect("equal")
        ax.set_xlim(-0.02, 1.02)
        ax.set_ylim(-0.02, 1.02)
        ax.grid(alpha=0.25, linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
        ax.tick_params(labelsize=8)
    figure.supxlabel("silent people taken for talkers", fontsize=9)
    figure.supylabel("talkers found talking", fontsize=9)
    _save(path, figure)


def save_rank_histograms(
    path: Path, counts: Mapping[str, Mapping[str, npt.NDArray[np.int64]]], p_values: Mapping[str, Mapping[str, float]]
) -> None:
    """Writes histograms of ranks as PNG; those that differ from uniform (p below 0.01) in another color.

    Args:
        path: image file; its folder is made if it is missing.
        counts: number of trials in every bin, by posterior and quantity.
        p_values: p-values of uniformity, likewise.

    Raises:
        InputError: there is nothing to draw.
        OSError: the file cannot be written; nothing is left behind.
    """
    if not counts:
        raise InputError("rank histograms: there is no posterior to draw; give at least one.")
    names = list(next(iter(counts.values())))
    figure = Figure(figsize=(1.45 * len(names), 1.15 * len(counts) + 0.6), dpi=110, layout="constrained")
    grid = figure.subplots(len(counts), len(names), squeeze=False, sharex=True)
    for axes, (posterior, by_quantity) in zip(grid, counts.items(), strict=True):
        for ax, name in zip(axes, names, strict=True):
            count_j = by_quantity[name]
            bins, trials = len(count_j), int(count_j.sum())
            # Where 99 of 100 bars of uniform ranks lie.
            low, high = stats.binom.ppf([0.005, 0.995], trials, 1 / bins)
            ax.axhspan(low, high, color=BAND, linewidth=0)
            color = FITS if p_values[posterior][name] >= LEAST_P else DIFFERS
            ax.bar((np.arange(bins) + 0.5) / bins, count_j, width=0.9 / bins, color=color)
            ax.set_ylim(0, max(2.5 * trials / bins, 1.05 * count_j.max()))
            ax.set_xlim(0, 1)
            ax.set_xticks([0, 0.5, 1], ["0", "", "1"])
            ax.set_yticks([])
            ax.tick_params(labelsize=7)
            ax.spines[["top", "right", "left"]].set_visible(False)
        axes[0].set_ylabel(posterior, fontsize=8, fontweight="bold")
    for ax, name in zip(grid[0], names, strict=True):
        ax.set_title(name, fontsize=8)
    figure.supxlabel("rank of the truth among the draws / L", fontsize=8)
    _save(path, figure)


def _save(path: Path, figure: Figure) -> None:
    FigureCanvasAgg(figure)
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    write_png(path, picture.getvalue())

"""Training curves: one small panel per series, raw values faint and a running mean on top."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from avssl_pyro.errors import InputError
from avssl_pyro.io.png import write_png
from avssl_pyro.training.metrics_logger import read_log

NUM_COLUMNS = 3
RAW_COLOR, MEAN_COLOR = "#9bb7d4", "#0b3c6f"


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


def _draw_panel(ax: Axes, title: str, steps: npt.NDArray[np.float64], values: npt.NDArray[np.float64]) -> None:
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
    """Writes training curves as PNG, with series such as loss, likelihood, kl_weights, kl_levels, sigma, beta.

    Args:
        path: the picture; its folder is made if it is not there.
        steps: training step of every record.
        series: one value per record and name; gaps may be NaN.

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
    FigureCanvasAgg(figure)
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for ax, (name, values) in zip(axes, series.items(), strict=False):
        _draw_panel(ax, name, np.asarray(steps, dtype=np.float64), np.asarray(values, dtype=np.float64))
    for ax in axes[len(series) :]:
        ax.set_visible(False)
    figure.supxlabel("training step", fontsize=9)
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    write_png(path, picture.getvalue())


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

"""Histograms of ranks: one row per posterior, one column per quantity, and where uniform counts would lie."""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy import stats

from avssl_pyro.errors import InputError
from avssl_pyro.io.png import write_png

FITS, DIFFERS, BAND = "#0b3c6f", "#d55e00", "0.88"
LEAST_P = 0.01


def save_rank_histograms(
    path: Path, counts: Mapping[str, Mapping[str, npt.NDArray[np.int64]]], p_values: Mapping[str, Mapping[str, float]]
) -> None:
    """Writes histograms as PNG; those that differ from uniform (p below 0.01) in another colour.

    Args:
        path: the picture; its folder is made if it is not there.
        counts: by posterior and quantity, trials in every bin.
        p_values: of uniformity, likewise.

    Raises:
        InputError: there is nothing to draw.
        OSError: the file cannot be written; nothing is left behind.
    """
    if not counts:
        raise InputError("rank histograms: there is no posterior to draw; give at least one.")
    names = list(next(iter(counts.values())))
    figure = Figure(figsize=(1.45 * len(names), 1.15 * len(counts) + 0.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
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
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    write_png(path, picture.getvalue())

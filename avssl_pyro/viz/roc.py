"""Receiver operating characteristics: one panel per array, one line per method."""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from avssl_pyro.errors import InputError
from avssl_pyro.io.png import write_png

COLORS = ("#0b3c6f", "#d55e00", "#009e73", "#cc79a7")
STYLES = ("-", "--", "-.", ":")

Curve = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]
"""Shares of false alarms and of hits, from (0, 0) to (1, 1)."""


def save_roc(path: Path, panels: Mapping[str, Mapping[str, Curve]]) -> None:
    """Writes curves as PNG.

    Args:
        path: the picture; its folder is made if it is not there.
        panels: per title, curves by their legend; a panel without curves says so.

    Raises:
        InputError: there is no panel.
        OSError: the file cannot be written; nothing is left behind.
    """
    if not panels:
        raise InputError("ROC: there is no panel to draw; give at least one.")
    figure = Figure(figsize=(3.6 * len(panels), 3.8), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for ax, (title, curves) in zip(axes, panels.items(), strict=True):
        ax.plot([0, 1], [0, 1], color="0.75", linewidth=0.8)
        for index, (label, (false_alarms_p, hits_p)) in enumerate(curves.items()):
            color, style = COLORS[index % len(COLORS)], STYLES[index % len(STYLES)]
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
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    write_png(path, picture.getvalue())

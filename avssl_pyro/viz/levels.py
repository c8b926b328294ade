"""Mixing levels as stacked bars: a column for every draw, a color for every class."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from avssl_pyro.errors import InputError
from avssl_pyro.viz.palette import OKABE_ITO, color_of


def draw_levels(panels: Mapping[str, npt.ArrayLike]) -> Figure:
    """Draws of mixing levels, from priors or posteriors, side by side.

    Args:
        panels: by title, draws (S, K), each summing to 1.

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

"""Pairing of true and estimated azimuths: the two orders of gating by tolerance and assigning that the field uses."""

from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from avssl_pyro.acoustics.grid import wrap_angle

# An error of exactly the tolerance counts as correct, whatever the rounding of degrees to radians did to it.
GATE_SLACK = 1e-9

Pairs = tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]


class Matching(Protocol):
    """Pairs rows (true) with columns (estimated) of an error matrix, each at most once, no pair beyond the gate."""

    def __call__(self, error_re: npt.NDArray[np.float64], tolerance: float) -> Pairs: ...


def angular_errors(reference: npt.ArrayLike, estimate: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Absolute angles between every true and every estimated azimuth, (R, E), radians, at most pi."""
    reference_r = np.asarray(reference, dtype=np.float64).reshape(-1)
    estimate_e = np.asarray(estimate, dtype=np.float64).reshape(-1)
    return np.abs(wrap_angle(reference_r[:, None] - estimate_e[None, :]))


def gate_then_assign(error_re: npt.NDArray[np.float64], tolerance: float) -> Pairs:
    """As many pairs within the tolerance as possible and, among such pairings, the least total error (LOCATA's order).

    Args:
        error_re: errors, (R, E), radians.
        tolerance: largest error that still counts as correct, radians.
    """
    inside_re = error_re <= tolerance + GATE_SLACK
    # Dearer than all pairs inside the gate together, so no pair is ever given up for a smaller error elsewhere.
    penalty = (min(error_re.shape) + 1) * (tolerance + GATE_SLACK)
    rows, columns = linear_sum_assignment(np.where(inside_re, error_re, penalty))
    kept = inside_re[rows, columns]
    return rows[kept], columns[kept]


def assign_then_gate(error_re: npt.NDArray[np.float64], tolerance: float) -> Pairs:
    """Least total error over all pairs first, then pairs beyond the tolerance are dropped (DCASE's order)."""
    rows, columns = linear_sum_assignment(error_re)
    kept = error_re[rows, columns] <= tolerance + GATE_SLACK
    return rows[kept], columns[kept]

"""Spread of the azimuths of source classes, in closed form.

The azimuth of a class is the top of a parabola through the log-weights of three neighbouring directions. Its standard
deviation delta follows from that of the log-weights (delta method). It is that of a model without errors: it leaves out
gains and positions of microphones that differ from those given, and early reflections. The stated spread is therefore
the geometric mean of delta and a constant, which was fitted on simulated scenes with such errors.
"""

import math

import torch
from torch import Tensor

# Fitted on simulated scenes with errors of gains and positions: one spread covers 0.7 of the errors there.
MISMATCH = math.radians(4.0)
LARGEST = math.pi / math.sqrt(3)
# Least curvature of a peak in log-weight per squared cell; flatter classes have no direction.
LEAST_CURVATURE = 1e-3


def azimuth_std(mu_bkd: Tensor, sigma_bkd: Tensor, spacing: float) -> Tensor:
    """Standard deviations of the azimuths of classes, (B, K), radians; at most that of a uniform distribution.

    Args:
        mu_bkd: means of log w, (B, K, D).
        sigma_bkd: standard deviations of log w, (B, K, D).
        spacing: angle between neighbouring directions in radians.

    >>> mu_bkd = torch.cos(torch.arange(8) * torch.pi / 4)[None, None]
    >>> azimuth_std(mu_bkd, torch.full((1, 1, 8), 0.01), spacing=torch.pi / 4).shape
    torch.Size([1, 1])
    """
    around_bk3 = _around(_peaks(mu_bkd), mu_bkd.shape[-1])
    before_bk, top_bk, after_bk = mu_bkd.gather(-1, around_bk3).unbind(-1)
    # Next to the three strongest there may be a higher cell, which is not the peak.
    before_bk, after_bk = before_bk.minimum(top_bk), after_bk.minimum(top_bk)
    curvature_bk = (2 * top_bk - before_bk - after_bk).clamp_min(LEAST_CURVATURE)
    slope_bk = after_bk - before_bk
    # Derivatives of the offset (after - before) / (2 curvature) by the three log-weights.
    derivative_bk3 = torch.stack([slope_bk - curvature_bk, -2 * slope_bk, slope_bk + curvature_bk], dim=-1) / (
        2 * curvature_bk.square()[..., None]
    )
    delta_bk = spacing * torch.linalg.vector_norm(derivative_bk3 * sigma_bkd.gather(-1, around_bk3), dim=-1)
    return (MISMATCH * delta_bk).sqrt().clamp_max(LARGEST)


def _peaks(mu_bkd: Tensor) -> Tensor:
    """Strongest of the three neighbours with the largest sum, (B, K, 1), where DirectLevelRule has the azimuth."""
    share_bkd = mu_bkd.softmax(-1)
    sum_bkd = share_bkd + share_bkd.roll(1, -1) + share_bkd.roll(-1, -1)
    around_bk3 = _around(sum_bkd.argmax(-1, keepdim=True), mu_bkd.shape[-1])
    return around_bk3.gather(-1, share_bkd.gather(-1, around_bk3).argmax(-1, keepdim=True))


def _around(index_bk1: Tensor, num_directions: int) -> Tensor:
    """Directions before, at and after an index, around the circle, (B, K, 3)."""
    return (index_bk1 + torch.tensor([-1, 0, 1], device=index_bk1.device)) % num_directions

"""Precedence weights: bins that the decay of earlier frames explains count less.

The ear localizes by onsets. With the power p of a bin, averaged over three neighbouring frequencies, and the
reverberation r to be expected of the frames before,

    r_tf = rho max(r_t-1,f, p_t-1,f),    c_tf ~ max(least, 1 - r_tf / p_tf),

a bin counts c_tf times in the log-likelihood. Weights have mean 1 over the loud frames. They make a composite
likelihood, which is no normalised density of x.
"""

import math
from typing import Any

import torch
from torch import Tensor

from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram, observe
from avssl_pyro.distributions.spatial_mixture import SpatialMixture

# Frames this far below the loudest do not decide on the scale of the weights.
LOUD_DB = 30.0


def precedence_weights(observed: ObservedSpectrogram, log_decay: float, least: float) -> Tensor:
    """Weights c_tf, (B..., F, T).

    Args:
        observed: spectrogram of all frames and frequencies.
        log_decay: log rho, the natural logarithm of the decay of power from frame to frame, negative.
        least: least weight before scaling.
    """
    m = observed.num_microphones
    raw_bft = observed.features_bfct[..., :m, :].sum(-2) + m * observed.floor_b[..., None, None]
    padded_bft = torch.cat([raw_bft[..., :1, :], raw_bft, raw_bft[..., -1:, :]], dim=-2)
    power_bft = (padded_bft[..., :-2, :] + padded_bft[..., 1:-1, :] + padded_bft[..., 2:, :]) / 3
    # r_t = max over s < t of rho^(t - s) p_s: a running maximum of log p once the decay is taken out.
    frame_t = torch.arange(raw_bft.shape[-1], dtype=raw_bft.dtype, device=raw_bft.device)
    level_bft = power_bft.log() - log_decay * frame_t
    before_bft = level_bft.cummax(-1).values[..., :-1]
    ratio_bft = (before_bft - level_bft[..., 1:]).exp()
    weight_bft = (1 - torch.cat([torch.zeros_like(raw_bft[..., :1]), ratio_bft], dim=-1)).clamp_min(least)
    frame_power_bt = raw_bft.mean(-2)
    loud_bt = frame_power_bt >= frame_power_bt.amax(-1, keepdim=True) * 10 ** (-LOUD_DB / 10)
    mean_b = (weight_bft.mean(-2) * loud_bt).sum(-1) / loud_bt.sum(-1)
    return weight_bft / mean_b[..., None, None]


def log_decay_of(decay_s: float, frame_s: float) -> float:
    """log rho of a decay by 60 dB in ``decay_s`` seconds, with ``frame_s`` seconds from frame to frame."""
    return -math.log(1e6) * frame_s / decay_s


class PrecedenceMixture(SpatialMixture):
    """:class:`SpatialMixture` whose bins count c_tf times.

    Args:
        *args: as of :class:`SpatialMixture`.
        log_decay: log rho, see :func:`precedence_weights`.
        least: least weight before scaling.
        **kwargs: as of :class:`SpatialMixture`.
    """

    def __init__(self, *args: Any, log_decay: float, least: float, **kwargs: Any) -> None:
        self.log_decay = log_decay
        self.least = least
        super().__init__(*args, **kwargs)

    def log_prob(self, value: Tensor | ObservedSpectrogram) -> Tensor:
        """sum_tf c_tf log p(x_tf), (B...)."""
        if self._validate_args and isinstance(value, Tensor):
            self._validate_sample(value)
        observed = observe(value) if isinstance(value, Tensor) else value
        weight_bft = precedence_weights(observed, self.log_decay, self.least)
        return (weight_bft * self.joint_log_prob(observed).logsumexp(dim=-2)).sum(dim=(-2, -1))

"""Prior and posterior predictive checks: statistics of a recording against those of replicas from the model.

Replicas are spectrograms that the model generates from draws of its prior or of a posterior. With power spectral
densities profiled out the model does not describe power. Neither do the statistics here: every bin is divided by its
norm first.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from avssl_pyro.guides.posterior_draws import PosteriorDraws, replicate

Statistic = Callable[[Tensor], Tensor]
"""Spectrograms (..., F, M, T) to numbers (..., P)."""


@dataclass(frozen=True)
class BeamPower:
    """Power over azimuth of a delay-and-sum beam, all bins made equally loud: (..., D), the mean over bins.

    Args:
        steering_fdm: steering vectors, complex (F, D, M).
    """

    steering_fdm: Tensor

    def __call__(self, x_fmt: Tensor) -> Tensor:
        return _beam_power(self.steering_fdm, x_fmt).mean((-3, -1))


@dataclass(frozen=True)
class Coherence:
    """Share of a bin's power in the strongest direction of its frequency, quantiles over bins: (..., 3).

    Bins of a mixture of few narrow sources are close to 1; bins of diffuse noise are not.

    Args:
        steering_fdm: steering vectors, complex (F, D, M).
    """

    steering_fdm: Tensor

    def __call__(self, x_fmt: Tensor) -> Tensor:
        best_n = _beam_power(self.steering_fdm, x_fmt).amax(-2).flatten(-2)
        return torch.quantile(best_n, torch.tensor([0.1, 0.5, 0.9]).to(best_n), dim=-1).movedim(0, -1)


@dataclass(frozen=True)
class PredictiveCheck:
    """Statistic of a recording and of its replicas.

    Args:
        observed_p: statistic of the recording, (P,).
        replicated_sp: statistics of the replicas, (S, P).
    """

    observed_p: Tensor
    replicated_sp: Tensor

    @property
    def p_values_p(self) -> Tensor:
        """Shares of replicas whose statistic is at least the recording's, (P,); near 0 or 1 the model does not fit."""
        return (self.replicated_sp >= self.observed_p).double().mean(0)

    @property
    def p_value(self) -> float:
        """Share of replicas at least as far from their mean as the recording, over all P numbers.

        The distance is the sum of squares in standard deviations of the replicas.
        """
        mean_p = self.replicated_sp.mean(0)
        std_p = self.replicated_sp.std(0).clamp_min(torch.finfo(mean_p.dtype).tiny)
        observed = ((self.observed_p - mean_p) / std_p).square().sum()
        replicated_s = ((self.replicated_sp - mean_p) / std_p).square().sum(-1)
        return float((replicated_s >= observed).double().mean())


@torch.no_grad()
def predictive_check(
    model: nn.Module, x_fmt: Tensor, image_cij: Tensor, draws: PosteriorDraws, statistic: Statistic, seed: int = 0
) -> PredictiveCheck:
    """Replicates a clip once from every draw and compares.

    Args:
        model: model with the sites of ``SpatialCGMM``.
        x_fmt: spectrogram of the recording, complex (F, M, T).
        image_cij: its image, (3, I, J).
        draws: draws of the prior (:func:`avssl_pyro.guides.posterior_draws.prior_draws`) or of a posterior.
        statistic: statistic such as :class:`BeamPower`.
        seed: seed of the replicas.
    """
    replicas_sfmt = replicate(model, x_fmt, image_cij, draws, seed)
    return PredictiveCheck(statistic(x_fmt), torch.stack([statistic(replica_fmt) for replica_fmt in replicas_sfmt]))


def _beam_power(steering_fdm: Tensor, x_fmt: Tensor) -> Tensor:
    """Share of every bin's power from every direction, (..., F, D, T), 0 to 1."""
    beam_fdt = steering_fdm.conj() @ x_fmt
    power_f1t = x_fmt.abs().square().sum(-2, keepdim=True).clamp_min(torch.finfo(x_fmt.real.dtype).tiny)
    return beam_fdt.abs().square() / steering_fdm.abs().square().sum(-1)[..., None] / power_f1t

"""Refined posteriors as targets: the networks learn to say at once what a few rounds of ascent would have told.

The posterior of a clip is climbed in closed form from where the guide stands, and the guide is drawn towards where that
leads by the cross-entropy of the sound's distribution over directions. No label takes part: the refined posterior is a
function of model, picture and recording. Classes enter through their mixture only, so it does not matter which of them
hears a source.
"""

import math
from dataclasses import dataclass
from typing import Any

import torch
from pyro.infer import Trace_ELBO
from torch import Tensor, nn

from avssl_pyro.distributions.ascent import LogWeightPrior, MixtureAscent
from avssl_pyro.distributions.profiled_gaussian import observe
from avssl_pyro.errors import InputError
from avssl_pyro.inference.terms import RecordsTerms
from avssl_pyro.models.spatial_cgmm import SpatialCGMM

# Close to the common overrelaxation of 2, and safe for a fixed number of rounds.
STRETCH = 1.8


@dataclass(frozen=True)
class TargetConfig:
    """How refined posteriors teach the guide.

    Args:
        weight: of the cross-entropy, in nats per clip, beside the ELBO per time-frequency bin; 0 turns it off.
        rounds: of ascent behind a target.
        smoothing_deg: standard deviation of the kernel that targets are smoothed with over directions, degrees.
        warmup: share of the training over which the weight rises from 0; the first starts are worth nothing.
        frame_step: every how many frames are used for targets.
    """

    weight: float = 0.0
    rounds: int = 4
    smoothing_deg: float = 5.0
    warmup: float = 0.15
    frame_step: int = 2

    def __post_init__(self) -> None:
        if not 0 <= self.weight < math.inf:
            raise InputError(f"TargetConfig: weight is {self.weight}; it must be at least 0.")
        if self.rounds < 1 or self.frame_step < 1 or not 0 < self.smoothing_deg < 180 or not 0 <= self.warmup <= 1:
            raise InputError(
                f"TargetConfig: rounds {self.rounds} and frame_step {self.frame_step} must be at least 1, "
                f"smoothing_deg {self.smoothing_deg} between 0 and 180, and warmup {self.warmup} between 0 and 1."
            )

    def weight_at(self, step: int, total_steps: int) -> float:
        """The weight at a step of the training."""
        return self.weight * min(1.0, step / max(1.0, self.warmup * total_steps))


class TaughtLoss(nn.Module):
    """The negative ELBO of a batch, with the cross-entropy to refined targets beside it.

    Args:
        loss: the estimator's loss module of model and guide.
        estimator: the estimator behind it; the guide's posterior is read off its last trace.
        model: the generative model.
        config: what targets are made of.
        prior_sigma, alpha: of the model's priors of log w and of the mixing levels.
        diffuse_class: the last class is for diffuse noise; what it hears comes from nowhere.
    """

    def __init__(
        self,
        loss: nn.Module,
        estimator: Trace_ELBO,
        model: SpatialCGMM,
        config: TargetConfig,
        *,
        prior_sigma: float = 1.0,
        alpha: float = 0.01,
        diffuse_class: bool = False,
    ) -> None:
        super().__init__()
        assert isinstance(estimator, RecordsTerms)
        self.loss = loss
        self._estimator: RecordsTerms = estimator
        self._num_directed = model.num_sources - diffuse_class
        # In a tuple, so that the model's parameters are not registered a second time.
        self._model = (model,)
        self._config = config
        self._prior_sigma = prior_sigma
        self._alpha = alpha

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor, target_weight: float) -> tuple[Tensor, Tensor]:
        """Loss per time-frequency bin, what is minimised, and the cross-entropy alone (nats per clip, detached)."""
        b, f, _, t = x_bfmt.shape
        (model,) = self._model
        loss = self.loss(x_bfmt, image_bcij) / (b * f * t * model.bin_weight)
        if target_weight == 0:
            return loss, torch.zeros_like(loss)
        cross_entropy = self._cross_entropy(x_bfmt)
        return loss + target_weight * cross_entropy, cross_entropy.detach()

    def _cross_entropy(self, x_bfmt: Tensor) -> Tensor:
        trace = self._estimator.guide_trace
        assert trace is not None
        # Several particles share the networks' directions, but have levels of their own.
        direction_posterior: Any = trace.nodes["direction_weights"]["fn"]
        level_posterior: Any = trace.nodes["mixing_levels"]["fn"]
        mu_pbkd = direction_posterior.base_dist.loc
        mu_bkd = mu_pbkd.reshape(-1, *mu_pbkd.shape[-3:])[0]
        level_pbk = level_posterior.mean
        pi_bk = level_pbk.reshape(-1, *level_pbk.shape[-2:]).mean(0)
        with torch.autocast(x_bfmt.device.type, enabled=False):
            target_bo = self._targets(x_bfmt[..., :: self._config.frame_step], mu_bkd.detach(), pi_bk.detach())
            log_outcome_bo = log_outcomes(mu_bkd.log_softmax(-1), pi_bk.log(), self._num_directed)
        return -(target_bo * log_outcome_bo).sum(-1).mean()

    @torch.no_grad()
    def _targets(self, x_bfmt: Tensor, mu_bkd: Tensor, pi_bk: Tensor) -> Tensor:
        (model,) = self._model
        prior = LogWeightPrior(torch.zeros_like(mu_bkd), mu_bkd.new_tensor(self._prior_sigma**-2))
        weight = self._config.frame_step * model.bin_weight
        ascent = MixtureAscent(observe(x_bfmt), model.template_dfmm, model.diffuse, prior, self._alpha, weight)
        point = ascent.step(mu_bkd, pi_bk)
        for _ in range(self._config.rounds - 1):
            point = ascent.step(point.log_w_bkd, point.pi_bk, STRETCH)
        share_bkd = point.log_w_bkd.softmax(-1) @ self._kernel(mu_bkd)
        return log_outcomes(share_bkd.log(), point.pi_bk.log(), self._num_directed).exp()

    def _kernel(self, like_bkd: Tensor) -> Tensor:
        """A von Mises kernel over directions, (D, D), each row summing to 1."""
        d = like_bkd.shape[-1]
        angle_d = 2 * math.pi / d * torch.arange(d, device=like_bkd.device, dtype=like_bkd.dtype)
        concentration = math.radians(self._config.smoothing_deg) ** -2
        return (concentration * (angle_d[:, None] - angle_d).cos()).softmax(-1)


def log_outcomes(log_share_bkd: Tensor, log_pi_bk: Tensor, num_directed: int) -> Tensor:
    """How the sound is distributed, (B, O), as logarithms: over the directions, sum_k pi_k w_kd, and from nowhere.

    Logarithms, because a share that the softmax has rounded to nothing keeps its gradient in them.

    Args:
        log_share_bkd: log w, normalised over the directions.
        log_pi_bk: logarithms of the mixing levels.
        num_directed: how many classes, the first ones, hear directions; O is D if these are all, otherwise D + 1.
    """
    n = num_directed
    directed_bd = (log_pi_bk[:, :n, None] + log_share_bkd[:, :n]).logsumexp(1)
    if n == log_pi_bk.shape[1]:
        return directed_bd
    return torch.cat([directed_bd, log_pi_bk[:, n:].logsumexp(-1, keepdim=True)], dim=-1)

"""The training loss: the negative ELBO plus the distillation of refined posteriors into the networks.

MAP-EM refines the posterior of a clip from the visual network's log-weights and equal levels, as a
:class:`avssl_pyro.guides.refined.RefinedGuide` does. Two cross-entropies draw the guide towards the result:

    L = -ELBO / bins + strength (weight CE_directions + level_weight CE_levels)

CE_directions compares the distributions of power over directions, mixed over classes, so the class of a source is
free. CE_levels compares levels class by class, and in a model with a room the shares of diffuse components of every
class. It trains the audio network alone; its gradient would move the visual network to directions with easily predicted
levels. No labels are used.
"""

import math
from typing import Any

import torch
from pyro.infer import Trace_ELBO
from torch import Tensor, nn

from avssl_pyro.distributions.map_em import MapEMState
from avssl_pyro.guides.amortized import AmortizedGuide, diffuse_mu
from avssl_pyro.guides.conjugacy import check_map_em, map_em_of
from avssl_pyro.guides.diffuse_start import with_diffuse_start
from avssl_pyro.models.spatial_cgmm import SpatialCGMM
from avssl_pyro.training.config import DistillationConfig
from avssl_pyro.training.elbo_terms import ElboTermsMixin

# Close to the common factor of 2, and safe for a fixed number of rounds.
OVERRELAXATION = 1.8


class DistillationLoss(nn.Module):
    """The negative ELBO of a batch plus weighted cross-entropies to refined posteriors.

    Args:
        loss: loss module of the estimator for model and guide.
        estimator: ELBO estimator of that module; its last trace holds the guide's posterior.
        model: generative model.
        guide: guide whose audio network is trained on levels; None without such a network.
        config: settings of the targets.
        diffuse_class: whether the last class models diffuse noise, which has no direction.
    """

    def __init__(
        self,
        loss: nn.Module,
        estimator: Trace_ELBO,
        model: SpatialCGMM,
        guide: AmortizedGuide | None,
        config: DistillationConfig,
        *,
        diffuse_class: bool = False,
    ) -> None:
        super().__init__()
        assert isinstance(estimator, ElboTermsMixin)
        self.loss = loss
        self._estimator: ElboTermsMixin = estimator
        self._num_directed = model.num_sources - diffuse_class
        # In tuples, so that their parameters are not registered a second time.
        self._model, self._guide = (model,), (guide,)
        self._config = config
        if config.weight or config.level_weight:
            check_map_em(model)

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor, strength: float) -> tuple[Tensor, Tensor]:
        """The loss, and the cross-entropies of directions and of levels (2,), nats per clip, detached.

        Args:
            x_bfmt, image_bcij: spectrograms and images of the batch.
            strength: factor of the weights of the cross-entropies.
        """
        b, f, _, t = x_bfmt.shape
        (model,) = self._model
        loss = self.loss(x_bfmt, image_bcij) / (b * f * t * model.bin_weight)
        if strength == 0:
            return loss, loss.new_zeros(2)
        cross_entropies = torch.stack(self._cross_entropies(x_bfmt))
        weights = cross_entropies.new_tensor([self._config.weight, self._config.level_weight])
        return loss + strength * weights @ cross_entropies, cross_entropies.detach()

    def _cross_entropies(self, x_bfmt: Tensor) -> tuple[Tensor, Tensor]:
        trace = self._estimator.guide_trace
        assert trace is not None
        # Particles share the networks' directions and differ in their levels.
        direction_posterior: Any = trace.nodes["direction_weights"]["fn"]
        level_posterior: Any = trace.nodes["mixing_levels"]["fn"]
        mu_pbkd = direction_posterior.base_dist.loc
        mu_bkd = mu_pbkd.reshape(-1, *mu_pbkd.shape[-3:])[0]
        level_pbk = level_posterior.mean
        pi_bk = level_pbk.reshape(-1, *level_pbk.shape[-2:]).mean(0)
        d = mu_bkd.shape[-1]
        with torch.autocast(x_bfmt.device.type, enabled=False):
            target = self._refine(x_bfmt, mu_bkd.detach())
            target_share_bkj = target.log_w_bkd.softmax(-1)
            directed_bkd = target_share_bkj[..., :d] @ self._kernel(mu_bkd)
            target_log_bkj = torch.cat([directed_bkd, target_share_bkj[..., d:]], dim=-1).log()
            target_bo = log_outcomes(target_log_bkj, target.pi_bk.log(), self._num_directed, d).exp()
            log_share_bkj = torch.cat([mu_bkd, *self._diffuse_mu(trace, mu_bkd)], dim=-1).log_softmax(-1)
            log_outcome_bo = log_outcomes(log_share_bkj, pi_bk.log(), self._num_directed, d)
        of_directions = -(target_bo * log_outcome_bo).sum(-1).mean()
        (guide,) = self._guide
        if guide is None or not self._config.level_weight:
            return of_directions, torch.zeros_like(of_directions)
        # At the weights by which levels are predicted when clips are localized, Eq. (1).
        feature_bcdt = guide.audio.direction_features(x_bfmt)
        mu_bkd = mu_bkd.detach()
        source_bkc = guide.source_features(feature_bcdt, mu_bkd.softmax(-1))
        concentration_bk = guide.concentration(source_bkc)
        log_level_bk = (concentration_bk / concentration_bk.sum(-1, keepdim=True)).log()
        of_levels = -(target.pi_bk * log_level_bk).sum(-1).mean()
        if guide.num_diffuse:
            diffuse_bkc = diffuse_mu(mu_bkd, guide.log_diffuse_ratios(source_bkc))
            log_share_bkj = torch.cat([mu_bkd, diffuse_bkc], dim=-1).log_softmax(-1)
            # Whatever their level: a silent person differs from a quiet talker by a more diffuse class.
            of_levels = of_levels + split_entropy(target_share_bkj, log_share_bkj, d).mean()
        return of_directions, of_levels

    def _diffuse_mu(self, trace: Any, mu_bkd: Tensor) -> tuple[Tensor, ...]:
        """Means of log e at those of log w, by the ratios of the first draw, (B, K, C), where there is a room."""
        (model,) = self._model
        if model.room is None:
            return ()
        drawn_pbkd, mu_pbkc = (
            trace.nodes["direction_weights"]["value"].log(),
            trace.nodes["diffuse_weights"]["fn"].base_dist.loc,
        )
        log_ratio_pbkc = mu_pbkc - drawn_pbkd.logsumexp(-1, keepdim=True)
        return (diffuse_mu(mu_bkd, log_ratio_pbkc.reshape(-1, *log_ratio_pbkc.shape[-3:])[0]),)

    @torch.no_grad()
    def _refine(self, x_bfmt: Tensor, mu_bkd: Tensor) -> MapEMState:
        (model,) = self._model
        map_em = map_em_of(model, x_bfmt, mu_bkd, frame_step=self._config.frame_step)
        start_bkj = with_diffuse_start(self._config.softening * mu_bkd, model.num_diffuse)
        return map_em.fit(start_bkj, self._config.rounds, overrelaxation=OVERRELAXATION)

    def _kernel(self, like_bkd: Tensor) -> Tensor:
        """A von Mises kernel over directions, (D, D), each row summing to 1."""
        d = like_bkd.shape[-1]
        angle_d = 2 * math.pi / d * torch.arange(d, device=like_bkd.device, dtype=like_bkd.dtype)
        concentration = math.radians(self._config.smoothing_deg) ** -2
        return (concentration * (angle_d[:, None] - angle_d).cos()).softmax(-1)


def log_outcomes(log_share_bkj: Tensor, log_pi_bk: Tensor, num_directed: int, num_directions: int) -> Tensor:
    """Log distribution of the power over directions, sum_k pi_k w_kd, and over no direction, (B, O).

    Logarithms keep the gradient of shares that a softmax rounds to zero.

    Args:
        log_share_bkj: log w and log e, together normalised, (B, K, D + C).
        log_pi_bk: logarithms of the mixing levels.
        num_directed: number of leading classes with directions.
        num_directions: D; O is D if all is directed, otherwise D + 1.
    """
    n, d = num_directed, num_directions
    directed_bd = (log_pi_bk[:, :n, None] + log_share_bkj[:, :n, :d]).logsumexp(1)
    diffuse_bn = (log_pi_bk[:, :n, None] + log_share_bkj[:, :n, d:]).flatten(1)
    rest_bn = torch.cat([diffuse_bn, log_pi_bk[:, n:]], dim=-1)
    if not rest_bn.shape[-1]:
        return directed_bd
    return torch.cat([directed_bd, rest_bn.logsumexp(-1, keepdim=True)], dim=-1)


def split_entropy(target_share_bkj: Tensor, log_share_bkj: Tensor, num_directions: int) -> Tensor:
    """Cross-entropy of the split of every class into all directions together and its diffuse components, (B, K)."""
    d = num_directions
    target_bk = torch.cat([target_share_bkj[..., :d].sum(-1, keepdim=True), target_share_bkj[..., d:]], dim=-1)
    log_bk = torch.cat([log_share_bkj[..., :d].logsumexp(-1, keepdim=True), log_share_bkj[..., d:]], dim=-1)
    return -(target_bk * log_bk).sum(-1)

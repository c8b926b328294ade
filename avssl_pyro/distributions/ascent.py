"""Closed-form ascent of the spatial mixture's posterior in direction weights and mixing levels.

With the power spectral density profiled out, a source is a complex angular central Gaussian, and the mixture a cACGMM
(Ito, Araki, Nakatani 2016) whose covariances are tied to the direction templates. Given responsibilities, majorising
the trace and linearising the log determinant bounds the log-likelihood of a class from below, for each weight apart, by

    - w_d (old)^2 pull_d / w_d - push_d w_d

with pull_d = sum_f a^H P Phi P a and push_d = sum_f n_f a^H P a. Without a prior its maximum is the multiplicative
update w <- w (pull / push)^(1/2) of non-negative matrix factorisation. With a prior of log w the maximum of bound plus
prior is found by Newton's method. Either way the objective never falls, and no step size is needed. The curvature of
the bound at its maximum is at least that of the posterior, so the spread it gives is a lower bound: it knows nothing of
weights that can trade places.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from avssl_pyro.acoustics.covariance import (
    form_coefficients,
    inverse_and_logdet,
    matrix_from_features,
    spatial_covariance,
    template_features,
)
from avssl_pyro.distributions.log_weight_priors import LogWeightPrior
from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram, quadratic_form

NEWTON_STEPS = 4
# Newton's step in log w is kept below this: far from its maximum the bound is steeper than its tangent tells.
LONGEST_STEP = 2.0


@dataclass(frozen=True)
class Tail:
    """log p(x | k) = -power log(x^H P x + offset) - log det H + const, in which the power spectral density is gone.

    Args:
        power: M if the density is profiled out (Eq. 14), more if an inverse gamma prior is integrated over.
        offset_b: in units of the scaled x of :class:`ObservedSpectrogram`, (B,).
    """

    power: float
    offset_b: Tensor


@dataclass(frozen=True)
class MixturePoint:
    """A point of the ascent.

    Args:
        log_w_bkd: log direction weights, (B, K, D).
        precision_bkd: curvature in log w of the bound on the log posterior, (B, K, D); the posterior's is smaller.
        counts_bk: expected numbers of time-frequency bins of every class, (B, K).
        log_likelihood_b: of the point before the step that led here, up to a constant of the clip, (B,).
    """

    log_w_bkd: Tensor
    precision_bkd: Tensor
    counts_bk: Tensor
    log_likelihood_b: Tensor

    @property
    def pi_bk(self) -> Tensor:
        """Mixing levels, (B, K)."""
        return self.counts_bk / self.counts_bk.sum(-1, keepdim=True)

    def choose(self, moves_b: Tensor, other: "MixturePoint") -> "MixturePoint":
        """The other point for the clips that move, this one for the rest."""
        return MixturePoint(
            torch.where(moves_b[:, None, None], other.log_w_bkd, self.log_w_bkd),
            torch.where(moves_b[:, None, None], other.precision_bkd, self.precision_bkd),
            torch.where(moves_b[:, None], other.counts_bk, self.counts_bk),
            torch.where(moves_b, other.log_likelihood_b, self.log_likelihood_b),
        )


class MixtureAscent:
    """Climbs the posterior of a batch of clips.

    Args:
        observed: the clips' spectrograms.
        template_dfmm: direction templates of the same frequencies, complex (D, F, M, M).
        diffuse: eps relative to the summed weights.
        tail: what the likelihood makes of x^H P x.
        prior: of log w, about ``prior_mean``.
        alpha: concentration of the Dirichlet prior of mixing levels, a number or (K,).
        weight: every observed bin counts so often; a thinned spectrogram then holds its own against the priors.
        prior_mean: broadcast against (B, K, D); 0, or a share of the visual network's mu to keep the picture in.
    """

    def __init__(
        self,
        observed: ObservedSpectrogram,
        template_dfmm: Tensor,
        diffuse: float,
        tail: Tail,
        prior: LogWeightPrior,
        alpha: Tensor | float,
        weight: float = 1.0,
        prior_mean: Tensor | float = 0.0,
    ) -> None:
        self._observed = observed
        self._template_dfmm = template_dfmm
        self._features_cd = template_features(template_dfmm).flatten(1).T.contiguous()
        self._diffuse = diffuse
        self._tail = tail
        self._prior = prior
        self._prior_mean = prior_mean
        self._alpha = alpha
        self._weight = weight

    @torch.no_grad()
    def step(self, log_w_bkd: Tensor, pi_bk: Tensor, stretch_b: Tensor | float = 1.0) -> MixturePoint:
        """One round: responsibilities at the given point, then levels and weights that explain them better.

        Args:
            log_w_bkd, pi_bk: the point.
            stretch_b: the change of log w is multiplied by it; 2 is the common overrelaxation, about twice as fast as
                a rule, but only 1 cannot fall.
        """
        tiny = torch.finfo(pi_bk.dtype).tiny
        share_bkd = log_w_bkd.softmax(-1)
        scm_bkfmm = spatial_covariance(share_bkd, self._template_dfmm, self._diffuse)
        inverse_bkfmm, logdet_bkf = inverse_and_logdet(scm_bkfmm)
        power, offset = self._tail.power, self._tail.offset_b[..., None, None, None]
        quad_bfkt = quadratic_form(self._observed, inverse_bkfmm).clamp_min_(0).add_(offset)
        bias_bfk = (pi_bk.clamp_min(tiny).log()[..., None] - logdet_bkf).transpose(-2, -1)
        joint_bfkt = torch.add(bias_bfk[..., None], quad_bfkt.log(), alpha=-power)
        evidence_bft = joint_bfkt.logsumexp(dim=-2)
        gamma_bfkt = joint_bfkt.sub_(evidence_bft[..., None, :]).exp_()
        count_bfk = gamma_bfkt.sum(-1)

        # Phi = power sum_t gamma x x^H / (x^H P x + offset), then P Phi P, both as M^2 real features.
        phi_bfkc = power * (gamma_bfkt.div_(quad_bfkt) @ self._observed.features_bfct.transpose(-2, -1))
        phi_bkfmm = matrix_from_features(phi_bfkc.transpose(-3, -2))
        pull_bkd = self._project(inverse_bkfmm @ phi_bkfmm @ inverse_bkfmm)
        push_bkd = self._project(count_bfk.transpose(-2, -1)[..., None, None] * inverse_bkfmm)

        # P was that of weights summing to 1; the bound is that of the weights themselves.
        weight_bkd = self._weight * share_bkd
        best_bkd, precision_bkd = self._maximize(log_w_bkd, weight_bkd * pull_bkd, weight_bkd * push_bkd)
        stretch_b11 = torch.as_tensor(stretch_b, dtype=pi_bk.dtype, device=pi_bk.device).reshape(-1, 1, 1)
        log_w_bkd = torch.lerp(self._center(log_w_bkd), best_bkd, stretch_b11)
        counts_bk = self._weight * count_bfk.sum(-2) + self._alpha
        return MixturePoint(log_w_bkd, precision_bkd, counts_bk, self._weight * evidence_bft.sum((-2, -1)))

    def _project(self, matrix_bkfmm: Tensor) -> Tensor:
        """sum_f tr((a_fd a_fd^H + eps I) Q_f), (B, K, D); eps, relative to the summed weights, is part of each."""
        trace_bk1 = matrix_bkfmm.diagonal(dim1=-2, dim2=-1).real.sum((-2, -1))[..., None]
        projected_bkd = form_coefficients(matrix_bkfmm).flatten(-2) @ self._features_cd
        return (projected_bkd + self._diffuse * trace_bk1).clamp_min(0)

    def _maximize(self, old_bkd: Tensor, pull_bkd: Tensor, push_bkd: Tensor) -> tuple[Tensor, Tensor]:
        """argmax over u of - pull e^(old - u) - push e^(u - old) + log prior(u), and the curvature there."""
        # The likelihood does not depend on the scale of w: put it where the prior likes it before comparing with it.
        change = torch.zeros_like(old_bkd)
        centered_bkd = self._center(old_bkd)
        about_mean_bkd = centered_bkd - self._prior_mean
        for _ in range(NEWTON_STEPS):
            falling, rising = pull_bkd * (-change).exp(), push_bkd * change.exp()
            log_w_bkd = about_mean_bkd + change
            gradient = falling - rising + self._prior.gradient(log_w_bkd)
            step = self._prior.newton_step(gradient, falling + rising, log_w_bkd)
            change = change + step.clamp(-LONGEST_STEP, LONGEST_STEP)
        precision_bkd = pull_bkd * (-change).exp() + push_bkd * change.exp()
        precision_bkd = precision_bkd + self._prior.precision(about_mean_bkd + change)
        return self._center(centered_bkd + change), precision_bkd

    def _center(self, log_w_bkd: Tensor) -> Tensor:
        return log_w_bkd + self._prior.shift(log_w_bkd - self._prior_mean)

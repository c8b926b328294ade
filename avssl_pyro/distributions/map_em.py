"""Closed-form ascent of the spatial mixture's posterior in direction weights and mixing levels.

With the power spectral density profiled out, a source is a complex angular central Gaussian, and the mixture a cACGMM
(Ito, Araki, Nakatani 2016) whose covariances are tied to the direction templates. Given responsibilities, majorising
the trace and linearising the log determinant bounds the log-likelihood of a class from below, for each weight apart, by

    - w_d (old)^2 pull_d / w_d - push_d w_d

with pull_d = sum_f a^H P Phi P a and push_d = sum_f n_f a^H P a. Without a prior its maximum is the multiplicative
update w <- w (pull / push)^(1/2) of non-negative matrix factorisation. With a prior of log w the maximum of bound plus
prior is found by Newton's method. Either way the objective never falls, and no step size is needed.

The bound is far steeper than the posterior, so the spread of log w is not read off it but off the expected (Fisher)
information of a complex Student t, of which the angular central Gaussian is one,

    I_d = sum_tf gamma_tf^2 w_d^2 [ p tr(P G_d P G_d) - (tr P G_d)^2 ] / (p + 1)

with power p and templates G_d = a a^H + eps I. With it, the variance of log w is that of the best normal guide. Masks
are not observed: of what a bin would tell of a class that it is known to be of, which has responsibility gamma, gamma^2
remains. Likewise the counts behind the levels are worth the mean over classes of (gamma - pi)^2 / pi of what they are.
"""

from dataclasses import dataclass
from typing import NamedTuple

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
# Some priors leave a direction that nothing is heard from nearly free; beyond this it is of no interest.
MOST_SPREAD = 4.0
# Where one class has nearly all bins the others are not told apart, and no Dirichlet describes that well.
LEAST_WORTH = 0.01
BISECTIONS = 30


@dataclass(frozen=True)
class DensityGenerator:
    """log p(x | k) = -power log(x^H P x + offset) - log det H + const, in which the power spectral density is gone.

    Args:
        power: M if the density is profiled out (Eq. 16), more if an inverse gamma prior is integrated over.
        offset_b: in units of the scaled x of :class:`ObservedSpectrogram`, (B,).
    """

    power: float
    offset_b: Tensor


@dataclass(frozen=True)
class MapEMState:
    """A point of the ascent.

    Args:
        log_w_bkd: log direction weights, (B, K, D).
        counts_bk: expected numbers of time-frequency bins of every class, (B, K).
        log_likelihood_b: of the point before the step that led here, up to a constant of the clip, (B,).
        objective_b: the same with the priors, which is what never falls, (B,).
    """

    log_w_bkd: Tensor
    counts_bk: Tensor
    log_likelihood_b: Tensor
    objective_b: Tensor

    @property
    def pi_bk(self) -> Tensor:
        """Mixing levels, (B, K)."""
        return self.counts_bk / self.counts_bk.sum(-1, keepdim=True)

    def choose(self, moves_b: Tensor, other: "MapEMState") -> "MapEMState":
        """The other point for the clips that move, this one for the rest."""
        return MapEMState(
            torch.where(moves_b[:, None, None], other.log_w_bkd, self.log_w_bkd),
            torch.where(moves_b[:, None], other.counts_bk, self.counts_bk),
            torch.where(moves_b, other.log_likelihood_b, self.log_likelihood_b),
            torch.where(moves_b, other.objective_b, self.objective_b),
        )


class _Expectation(NamedTuple):
    """The E-step: P, x^H P x + offset, responsibilities, and the evidence of every bin."""

    inverse_bkfmm: Tensor
    quad_bfkt: Tensor
    gamma_bfkt: Tensor
    evidence_bft: Tensor


class MapEM:
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
        tail: DensityGenerator,
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
    def step(self, log_w_bkd: Tensor, pi_bk: Tensor, stretch_b: Tensor | float = 1.0) -> MapEMState:
        """One round: responsibilities at the given point, then levels and weights that explain them better.

        Args:
            log_w_bkd, pi_bk: the point.
            stretch_b: the change of log w is multiplied by it; 2 is the common overrelaxation, about twice as fast as
                a rule, but only 1 cannot fall.
        """
        log_prior_b = self._prior.log_density(self._center(log_w_bkd) - self._prior_mean)
        log_prior_b = log_prior_b + (self._alpha * pi_bk.clamp_min(torch.finfo(pi_bk.dtype).tiny).log()).sum(-1)
        expected = self._expect(log_w_bkd, pi_bk)
        inverse_bkfmm, gamma_bfkt, power = expected.inverse_bkfmm, expected.gamma_bfkt, self._tail.power
        count_bfk = gamma_bfkt.sum(-1)

        # Phi = power sum_t gamma x x^H / (x^H P x + offset), then P Phi P, both as M^2 real features.
        phi_bfkc = power * (gamma_bfkt.div_(expected.quad_bfkt) @ self._observed.features_bfct.transpose(-2, -1))
        phi_bkfmm = matrix_from_features(phi_bfkc.transpose(-3, -2))
        pull_bkd = self._project(inverse_bkfmm @ phi_bkfmm @ inverse_bkfmm)
        push_bkd = self._project(count_bfk.transpose(-2, -1)[..., None, None] * inverse_bkfmm)

        # P was that of weights summing to 1; the bound is that of the weights themselves.
        weight_bkd = self._weight * log_w_bkd.softmax(-1)
        best_bkd = self._maximize(log_w_bkd, weight_bkd * pull_bkd, weight_bkd * push_bkd)
        stretch_b11 = torch.as_tensor(stretch_b, dtype=pi_bk.dtype, device=pi_bk.device).reshape(-1, 1, 1)
        log_w_bkd = torch.lerp(self._center(log_w_bkd), best_bkd, stretch_b11)
        counts_bk = self._weight * count_bfk.sum(-2) + self._alpha
        log_likelihood_b = self._weight * expected.evidence_bft.sum((-2, -1))
        return MapEMState(log_w_bkd, counts_bk, log_likelihood_b, log_likelihood_b + log_prior_b)

    @torch.no_grad()
    def uncertainty(self, point: MapEMState) -> tuple[Tensor, Tensor]:
        """Standard deviations of log w at a point, (B, K, D), and concentrations of pi, (B, K).

        Both come from the expected information of bins whose masks are not observed, and from the priors.
        """
        expected, power = self._expect(point.log_w_bkd, point.pi_bk), self._tail.power
        inverse_bkfmm, weight_bkfd = expected.inverse_bkfmm, point.log_w_bkd.softmax(-1)[:, :, None]
        square_bkfmm = inverse_bkfmm @ inverse_bkfmm
        first_bkfd, second_bkfd = self._per_bin(inverse_bkfmm), self._per_bin(square_bkfmm)
        trace_bkf1, square_bkf1 = _trace(inverse_bkfmm)[..., None], _trace(square_bkfmm)[..., None]
        twice_bkfd = first_bkfd.square() + 2 * self._diffuse * second_bkfd + self._diffuse**2 * square_bkf1
        once_bkfd = first_bkfd + self._diffuse * trace_bkf1
        information_bkfd = weight_bkfd.square() * (power * twice_bkfd - once_bkfd.square()) / (power + 1)
        square_bkf = expected.gamma_bfkt.square().sum(-1).transpose(-2, -1)
        precision_bkd = self._weight * (square_bkf[..., None] * information_bkfd).sum(-2).clamp_min(0)
        return self._best_spread(point.log_w_bkd, precision_bkd), self._worth(point, square_bkf) * point.counts_bk

    def _worth(self, point: MapEMState, square_bkf: Tensor) -> Tensor:
        """Share of the counts that would tell as much with masks observed as all of them do without, (B, 1)."""
        pi_bk = point.pi_bk.clamp_min(torch.finfo(point.pi_bk.dtype).tiny)
        bins = self._observed.features_bfct.shape[-3] * self._observed.features_bfct.shape[-1]
        contrast_b = (square_bkf.sum(-1) / (bins * pi_bk)).sum(-1) - 1
        return (contrast_b / max(pi_bk.shape[-1] - 1, 1)).clamp(LEAST_WORTH, 1)[:, None]

    def _best_spread(self, log_w_bkd: Tensor, precision_bkd: Tensor) -> Tensor:
        about_mean_bkd = log_w_bkd - self._prior_mean
        # variance * (information + expected precision of the prior) = 1; the left side rises with the variance.
        low_bkd, high_bkd = torch.zeros_like(precision_bkd), torch.full_like(precision_bkd, MOST_SPREAD**2)
        for _ in range(BISECTIONS):
            middle_bkd = (low_bkd + high_bkd) / 2
            above_bkd = middle_bkd * (precision_bkd + self._prior.precision(about_mean_bkd, middle_bkd)) > 1
            low_bkd = torch.where(above_bkd, low_bkd, middle_bkd)
            high_bkd = torch.where(above_bkd, middle_bkd, high_bkd)
        return high_bkd.sqrt()

    def _expect(self, log_w_bkd: Tensor, pi_bk: Tensor) -> _Expectation:
        tiny = torch.finfo(pi_bk.dtype).tiny
        scm_bkfmm = spatial_covariance(log_w_bkd.softmax(-1), self._template_dfmm, self._diffuse)
        inverse_bkfmm, logdet_bkf = inverse_and_logdet(scm_bkfmm)
        quad_bfkt = quadratic_form(self._observed, inverse_bkfmm).clamp_min_(0)
        quad_bfkt.add_(self._tail.offset_b[..., None, None, None])
        bias_bfk = (pi_bk.clamp_min(tiny).log()[..., None] - logdet_bkf).transpose(-2, -1)
        joint_bfkt = torch.add(bias_bfk[..., None], quad_bfkt.log(), alpha=-self._tail.power)
        evidence_bft = joint_bfkt.logsumexp(dim=-2)
        gamma_bfkt = joint_bfkt.sub_(evidence_bft[..., None, :]).exp_()
        return _Expectation(inverse_bkfmm, quad_bfkt, gamma_bfkt, evidence_bft)

    def _per_bin(self, matrix_bkfmm: Tensor) -> Tensor:
        """a_fd^H Q_f a_fd, (B, K, F, D)."""
        b, k, f, _, _ = matrix_bkfmm.shape
        coefficients_fnc = form_coefficients(matrix_bkfmm).flatten(0, 1).transpose(0, 1)
        features_fcd = self._features_cd.unflatten(0, (f, -1))
        return (coefficients_fnc @ features_fcd).transpose(0, 1).reshape(b, k, f, -1)

    def _project(self, matrix_bkfmm: Tensor) -> Tensor:
        """sum_f tr((a_fd a_fd^H + eps I) Q_f), (B, K, D); eps, relative to the summed weights, is part of each."""
        trace_bk1 = _trace(matrix_bkfmm).sum(-1, keepdim=True)
        projected_bkd = form_coefficients(matrix_bkfmm).flatten(-2) @ self._features_cd
        return (projected_bkd + self._diffuse * trace_bk1).clamp_min(0)

    def _maximize(self, old_bkd: Tensor, pull_bkd: Tensor, push_bkd: Tensor) -> Tensor:
        """argmax over u of - pull e^(old - u) - push e^(u - old) + log prior(u)."""
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
        return self._center(centered_bkd + change)

    def _center(self, log_w_bkd: Tensor) -> Tensor:
        return log_w_bkd + self._prior.shift(log_w_bkd - self._prior_mean)


def _trace(matrix: Tensor) -> Tensor:
    return matrix.diagonal(dim1=-2, dim2=-1).real.sum(-1)

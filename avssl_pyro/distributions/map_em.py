"""MAP-EM: maximises the posterior of direction weights and mixing levels by closed-form updates.

With the power spectral density profiled out, a source is a complex angular central Gaussian, and the mixture a cACGMM
(Ito, Araki, Nakatani 2016) whose covariances are tied to the direction templates. Given responsibilities, majorising
the trace and linearising the log determinant bounds the log-likelihood of a class from below, for each weight apart, by

    - w_d (old)^2 pull_d / w_d - push_d w_d

with pull_d = sum_f a^H P Phi P a and push_d = sum_f n_f a^H P a. Without a prior the maximum is the multiplicative
update w <- w (pull / push)^(1/2) of non-negative matrix factorisation. With a prior of log w, Newton's method finds the
maximum of bound plus prior. In both cases the objective never falls, and no step size is needed.

The bound is far steeper than the posterior. The spread of log w therefore comes from the expected (Fisher) information
of a complex Student t, of which the angular central Gaussian is one,

    I_d = sum_tf gamma_tf^2 w_d^2 [ p tr(P G_d P G_d) - (tr P G_d)^2 ] / (p + 1)

with power p and templates G_d = a a^H + eps I. It gives log w the variance of the best normal guide. Masks are not
observed: of the information of a bin about a class with responsibility gamma, the share gamma^2 remains. The counts
behind the levels are likewise multiplied by the mean over classes of (gamma - pi)^2 / pi.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from avssl_pyro.distributions.e_step import DensityGenerator, EStep
from avssl_pyro.distributions.log_weight_priors import LogWeightPrior
from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram

NEWTON_STEPS = 4
# Largest Newton step in log w: far from its maximum the bound is steeper than its tangent.
LONGEST_STEP = 2.0
# Largest standard deviation of log w: some priors leave a silent direction nearly free.
MOST_SPREAD = 4.0
# Least factor of the counts: where one class has nearly all bins, no Dirichlet describes the levels well.
LEAST_WORTH = 0.01
BISECTIONS = 30
# Relaxation of a fit until it overshoots: twice the closed-form step.
OVERRELAXATION = 2.0


@dataclass(frozen=True)
class MapEMState:
    """One iterate of MAP-EM.

    Args:
        log_w_bkd: log direction weights, (B, K, D).
        counts_bk: expected numbers of time-frequency bins of every class, (B, K).
        log_likelihood_b: log-likelihood before the step that led here, up to a constant of the clip, (B,).
        objective_b: log posterior there, which never falls, (B,).
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
        """``other`` for the clips that move, this one for the rest."""
        return MapEMState(
            torch.where(moves_b[:, None, None], other.log_w_bkd, self.log_w_bkd),
            torch.where(moves_b[:, None], other.counts_bk, self.counts_bk),
            torch.where(moves_b, other.log_likelihood_b, self.log_likelihood_b),
            torch.where(moves_b, other.objective_b, self.objective_b),
        )


class MapEM:
    """MAP estimates of direction weights and mixing levels of a batch of clips.

    Args:
        observed: spectrograms of the clips.
        template_dfmm: direction templates of the same frequencies, complex (D, F, M, M).
        diffuse: eps relative to the summed weights.
        density_generator: power and offset of the likelihood.
        prior: prior of log w about ``prior_mean``.
        alpha: concentration of the Dirichlet prior of mixing levels, a number or (K,).
        weight: multiplicity of every observed bin; a thinned spectrogram keeps its balance with the priors.
        prior_mean: mean of log w, broadcast against (B, K, D); 0, or a share of the visual network's mu.
        bin_weight_bft: weights of single bins, as of :class:`EStep`.

    Templates may be of any rank; diffuse components are further ones, with their weights beside those of directions.
    """

    def __init__(
        self,
        observed: ObservedSpectrogram,
        template_dfmm: Tensor,
        diffuse: float,
        density_generator: DensityGenerator,
        prior: LogWeightPrior,
        alpha: Tensor | float,
        weight: float = 1.0,
        prior_mean: Tensor | float = 0.0,
        bin_weight_bft: Tensor | None = None,
    ) -> None:
        self._e_step = EStep(observed, template_dfmm, diffuse, density_generator, bin_weight_bft)
        self._prior = prior
        self._prior_mean = prior_mean
        self._alpha = alpha
        self._weight = weight

    @torch.no_grad()
    def fit(
        self,
        log_w_bkd: Tensor,
        rounds: int,
        *,
        tolerance: float | None = None,
        overrelaxation: float = OVERRELAXATION,
    ) -> MapEMState:
        """Runs up to ``rounds`` rounds from the given log-weights and equal levels; the first is not relaxed.

        Classes start at equal levels, because one that starts quiet stays quiet.

        Args:
            log_w_bkd: log-weights to start at.
            rounds: most rounds, at least 1.
            tolerance: gain in log posterior per time-frequency bin at which a clip stops. A clip then also drops its
                overrelaxation at the first fall. None runs all rounds, all of them relaxed.
            overrelaxation: relaxation of every round but the first, see :meth:`step`.
        """
        state = self.step(log_w_bkd, log_w_bkd.new_full(log_w_bkd.shape[:-1], 1 / log_w_bkd.shape[-2]))
        moving_b = torch.ones_like(state.objective_b, dtype=torch.bool)
        relaxation_b = torch.full_like(state.objective_b, overrelaxation)
        # The gain of a round is known in the next one, which has been relaxed already.
        relaxed_b = torch.zeros_like(moving_b)
        for _ in range(rounds - 1):
            new = self.step(state.log_w_bkd, state.pi_bk, relaxation_b)
            if tolerance is None:
                state = new
                continue
            gain_b = (new.objective_b - state.objective_b) / state.counts_bk.sum(-1)
            # A converged clip stays where it is, so that its result does not depend on its batch.
            state = state.choose(moving_b, new)
            # A fall after a relaxed round is an overshoot, not convergence.
            moving_b = moving_b & ((gain_b > tolerance) | (gain_b < 0) & relaxed_b)
            relaxed_b = relaxation_b > 1
            relaxation_b = torch.where(gain_b < 0, 1.0, relaxation_b)
            if not moving_b.any():
                break
        return state

    @torch.no_grad()
    def step(self, log_w_bkd: Tensor, pi_bk: Tensor, relaxation_b: Tensor | float = 1.0) -> MapEMState:
        """One round: responsibilities at the given point, then the levels and weights that maximise the bound.

        Args:
            log_w_bkd: log direction weights of the point.
            pi_bk: mixing levels of the point.
            relaxation_b: factor of the change of log w; 2 is about twice as fast as 1, but only 1 never falls.
        """
        log_prior_b = self._prior.log_density(self._center(log_w_bkd) - self._prior_mean)
        log_prior_b = log_prior_b + (self._alpha * pi_bk.clamp_min(torch.finfo(pi_bk.dtype).tiny).log()).sum(-1)
        expected = self._e_step(log_w_bkd, pi_bk)
        inverse_bkfmm, count_bfk = expected.inverse_bkfmm, expected.gamma_bfkt.sum(-1)
        phi_bkfmm = self._e_step.weighted_covariance(expected)
        pull_bkd = self._e_step.project(inverse_bkfmm @ phi_bkfmm @ inverse_bkfmm)
        push_bkd = self._e_step.project(count_bfk.transpose(-2, -1)[..., None, None] * inverse_bkfmm)

        # P belongs to weights summing to 1; the bound is a function of the weights themselves.
        weight_bkd = self._weight * log_w_bkd.softmax(-1)
        best_bkd = self._maximize(log_w_bkd, weight_bkd * pull_bkd, weight_bkd * push_bkd)
        relaxation_b11 = torch.as_tensor(relaxation_b, dtype=pi_bk.dtype, device=pi_bk.device).reshape(-1, 1, 1)
        log_w_bkd = torch.lerp(self._center(log_w_bkd), best_bkd, relaxation_b11)
        counts_bk = self._weight * count_bfk.sum(-2) + self._alpha
        log_likelihood_b = self._weight * expected.evidence_bft.sum((-2, -1))
        return MapEMState(log_w_bkd, counts_bk, log_likelihood_b, log_likelihood_b + log_prior_b)

    @torch.no_grad()
    def uncertainty(self, state: MapEMState) -> tuple[Tensor, Tensor]:
        """Standard deviations of log w, (B, K, D), and concentrations of pi, (B, K), at a point.

        Both come from the expected information of bins whose masks are not observed, and from the priors.
        """
        expected = self._e_step(state.log_w_bkd, state.pi_bk)
        square_bkf = self._e_step.square_responsibilities(expected)
        weight_bkfd = state.log_w_bkd.softmax(-1)[:, :, None]
        information_bkfd = weight_bkfd.square() * self._e_step.information(expected.inverse_bkfmm)
        precision_bkd = self._weight * (square_bkf[..., None] * information_bkfd).sum(-2).clamp_min(0)
        return self._spread(state.log_w_bkd, precision_bkd), self._worth(state, square_bkf) * state.counts_bk

    def _worth(self, state: MapEMState, square_bkf: Tensor) -> Tensor:
        """Share of the counts that carries the same information with observed masks, (B, 1)."""
        pi_bk = state.pi_bk.clamp_min(torch.finfo(state.pi_bk.dtype).tiny)
        contrast_b = (square_bkf.sum(-1) / (self._e_step.num_bins * pi_bk)).sum(-1) - 1
        return (contrast_b / max(pi_bk.shape[-1] - 1, 1)).clamp(LEAST_WORTH, 1)[:, None]

    def _spread(self, log_w_bkd: Tensor, precision_bkd: Tensor) -> Tensor:
        about_mean_bkd = log_w_bkd - self._prior_mean
        # variance * (information + expected precision of the prior) = 1; the left side rises with the variance.
        low_bkd, high_bkd = torch.zeros_like(precision_bkd), torch.full_like(precision_bkd, MOST_SPREAD**2)
        for _ in range(BISECTIONS):
            middle_bkd = (low_bkd + high_bkd) / 2
            above_bkd = middle_bkd * (precision_bkd + self._prior.precision(about_mean_bkd, middle_bkd)) > 1
            low_bkd = torch.where(above_bkd, low_bkd, middle_bkd)
            high_bkd = torch.where(above_bkd, middle_bkd, high_bkd)
        return high_bkd.sqrt()

    def _maximize(self, old_bkd: Tensor, pull_bkd: Tensor, push_bkd: Tensor) -> Tensor:
        """argmax over u of - pull e^(old - u) - push e^(u - old) + log prior(u)."""
        # The likelihood does not depend on the scale of w, so the scale of greatest prior density comes first.
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

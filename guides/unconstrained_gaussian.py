"""Gaussians of the unconstrained latents of clips: log w, and mixing levels by stick breaking."""

from collections.abc import Sequence
from dataclasses import dataclass

import pyro.distributions as dist
import torch
from pyro.distributions import TorchDistribution
from torch import Tensor
from torch.distributions import transforms

# Range in which logits of stick fractions are resolved. A class at the least level is silent anyway, and the logit of
# one that a sparse prior has emptied has a spread of a hundred, too wide for a normal distribution.
MOST_LOGIT = 12.0
LEAST_SCALE, MOST_SCALE = 0.02, 2.0


@dataclass(frozen=True)
class UnconstrainedGaussian:
    """N(loc, diag(scale^2) + factor factor^T) of B clips; the first K D latents are log w, the last K - 1 the sticks.

    Args:
        loc_bn: means, (B, N) with N = K D + K - 1.
        scale_bn: standard deviations of the independent parts of the latents, (B, N).
        factor_bnr: loadings of R shared factors, (B, N, R); R may be 0.
        num_sources: K.
    """

    loc_bn: Tensor
    scale_bn: Tensor
    factor_bnr: Tensor
    num_sources: int

    @property
    def num_weights(self) -> int:
        """K D."""
        return self.loc_bn.shape[-1] - self.num_sources + 1

    @property
    def mu_bkd(self) -> Tensor:
        """Means of log w, (B, K, D)."""
        return self.loc_bn[..., : self.num_weights].unflatten(-1, (self.num_sources, -1))

    @property
    def sigma_bkd(self) -> Tensor:
        """Marginal standard deviations of log w, (B, K, D)."""
        variance_bn = self.scale_bn.square() + self.factor_bnr.square().sum(-1)
        return variance_bn[..., : self.num_weights].sqrt().unflatten(-1, (self.num_sources, -1))

    def clip(self, b: int) -> "UnconstrainedGaussian":
        """The Gaussian of one clip, still with an axis of clips."""
        clip = slice(b, b + 1)
        return UnconstrainedGaussian(self.loc_bn[clip], self.scale_bn[clip], self.factor_bnr[clip], self.num_sources)

    @staticmethod
    def stack(clips: Sequence["UnconstrainedGaussian"]) -> "UnconstrainedGaussian":
        """The Gaussians of several clips as one."""
        return UnconstrainedGaussian(
            torch.cat([clip.loc_bn for clip in clips]),
            torch.cat([clip.scale_bn for clip in clips]),
            torch.cat([clip.factor_bnr for clip in clips]),
            clips[0].num_sources,
        )

    def sites_of(self, latent_bn: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """w (B, K, D) and pi (B, K) of unconstrained latents (B, N), and the log Jacobian (B,)."""
        log_w_bn, stick_bk = latent_bn.split([self.num_weights, self.num_sources - 1], dim=-1)
        # Its density needs the sticks, which the levels of nearly empty classes do not determine.
        stick_breaking = transforms.StickBreakingTransform(cache_size=1)
        pi_bk = stick_breaking(stick_bk)
        jacobian_b = log_w_bn.sum(-1) + stick_breaking.log_abs_det_jacobian(stick_bk, pi_bk)
        return log_w_bn.exp().unflatten(-1, (self.num_sources, -1)), pi_bk, jacobian_b

    def direction_posterior(self) -> TorchDistribution:
        """q(w), batch_shape (B,), event_shape (K, D)."""
        if not self.factor_bnr.shape[-1]:
            # The same distribution in a form for which torch has the divergence from a log-normal prior.
            return dist.LogNormal(self.mu_bkd, self.sigma_bkd).to_event(2)
        n, shape = self.num_weights, self.mu_bkd.shape[-2:]
        log_w = dist.LowRankMultivariateNormal(
            self.loc_bn[..., :n], self.factor_bnr[..., :n, :], self.scale_bn[..., :n].square()
        )
        return dist.TransformedDistribution(
            log_w, [transforms.ExpTransform(), transforms.ReshapeTransform(torch.Size((n,)), shape)]
        )

    def level_posterior(self, w_bkd: Tensor) -> TorchDistribution:
        """q(pi | w), batch_shape (B,), event_shape (K,): the shared factors are conditioned on w.

        With precision A = I + F_w^T S_w^-2 F_w the factors given w are N(A^-1 F_w^T S_w^-2 (log w - mu), A^-1).
        """
        n = self.num_weights
        loc_bn, scale_bn, factor_bnr = self.loc_bn[..., n:], self.scale_bn[..., n:], self.factor_bnr[..., n:, :]
        # Its density needs the sticks, which the levels of nearly empty classes do not determine.
        stick_breaking = transforms.StickBreakingTransform(cache_size=1)
        if not factor_bnr.shape[-1]:
            loc_bn = loc_bn.expand(*w_bkd.shape[:-2], -1)
            return dist.TransformedDistribution(dist.Normal(loc_bn, scale_bn).to_event(1), [stick_breaking])
        loading_bnr = self.factor_bnr[..., :n, :] / self.scale_bn[..., :n, None]
        standardised_bn = (w_bkd.log() - self.mu_bkd).flatten(-2) / self.scale_bn[..., :n]
        precision_brr = loading_bnr.mT @ loading_bnr + torch.eye(loading_bnr.shape[-1]).to(loading_bnr)
        covariance_brr = torch.cholesky_inverse(torch.linalg.cholesky(precision_brr))
        projected_br1 = loading_bnr.mT @ standardised_bn[..., None]
        mean_bn = loc_bn + (factor_bnr @ covariance_brr @ projected_br1).squeeze(-1)
        # L L^T = A^-1, so that F L stands in for the factors' own loadings.
        left_bnr = factor_bnr @ torch.linalg.cholesky(covariance_brr)
        variance_bn = scale_bn.square().expand_as(mean_bn)
        sticks = dist.LowRankMultivariateNormal(mean_bn, left_bnr.expand(*mean_bn.shape, -1), variance_bn)
        return dist.TransformedDistribution(sticks, [stick_breaking])


def log_normal_and_dirichlet(mu_bkd: Tensor, sigma_bkd: Tensor, concentration_bk: Tensor) -> UnconstrainedGaussian:
    """The Gaussian with the moments of w ~ LogNormal(mu, sigma^2) and pi ~ Dir(concentration) in unconstrained space.

    The sticks of a Dirichlet are independent betas, and of the logit of Beta(a, b) mean and variance are
    psi(a) - psi(b) and psi'(a) + psi'(b); both are limited for classes that a sparse posterior has emptied.
    """
    num_sources = concentration_bk.shape[-1]
    stick_bk = concentration_bk[..., :-1]
    rest_bk = concentration_bk.flip(-1).cumsum(-1).flip(-1)[..., 1:]
    # torch breaks sticks so that 0 stands for equal levels.
    offset_k = torch.arange(num_sources - 1, 0, -1).to(concentration_bk).log()
    logit_bk = (stick_bk.digamma() - rest_bk.digamma()).clamp(-MOST_LOGIT, MOST_LOGIT)
    spread_bk = (torch.polygamma(1, stick_bk) + torch.polygamma(1, rest_bk)).sqrt()
    loc_bn = torch.cat([mu_bkd.flatten(-2), logit_bk + offset_k], dim=-1)
    scale_bn = torch.cat([sigma_bkd.flatten(-2), spread_bk], dim=-1).clamp(LEAST_SCALE, MOST_SCALE)
    return UnconstrainedGaussian(loc_bn, scale_bn, loc_bn.new_zeros(*loc_bn.shape, 0), num_sources)

"""Gaussians of the unconstrained latents of clips: log w, mixing levels by stick breaking, and log e with a room."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import pyro
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
    """N(loc, diag(scale^2) + factor factor^T) over the latents of B clips.

    The K D log-weights w come first, then the K - 1 sticks of the levels pi, then the K C log-weights e of a room.

    Args:
        loc_bn: means, (B, N) with N = K D + K - 1 + K C.
        scale_bn: standard deviations of the independent parts of the latents, (B, N).
        factor_bnr: loadings of R shared factors, (B, N, R); R may be 0.
        num_sources: number of classes K.
        num_components: number of diffuse components C; 0 without a room.
    """

    loc_bn: Tensor
    scale_bn: Tensor
    factor_bnr: Tensor
    num_sources: int
    num_components: int = 0

    @property
    def num_diffuse(self) -> int:
        """K C."""
        return self.num_sources * self.num_components

    @property
    def num_weights(self) -> int:
        """K D."""
        return self.loc_bn.shape[-1] - self.num_sources + 1 - self.num_diffuse

    def split(self, value_bn: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Values of latents (..., N) as those of w (..., K, D), of sticks (..., K - 1) and of e (..., K, C)."""
        w_bn, stick_bk, e_bn = value_bn.split([self.num_weights, self.num_sources - 1, self.num_diffuse], dim=-1)
        k = self.num_sources
        return w_bn.unflatten(-1, (k, -1)), stick_bk, e_bn.unflatten(-1, (k, self.num_components))

    @property
    def mu_bkd(self) -> Tensor:
        """Means of log w, (B, K, D)."""
        return self.split(self.loc_bn)[0]

    @property
    def sigma_bkd(self) -> Tensor:
        """Marginal standard deviations of log w, (B, K, D)."""
        return self.split(self._marginal_variance_bn)[0].sqrt()

    @property
    def diffuse_mu_bkc(self) -> Tensor | None:
        """Means of log e, (B, K, C); None without a room."""
        return self.split(self.loc_bn)[2] if self.num_components else None

    @property
    def diffuse_sigma_bkc(self) -> Tensor | None:
        """Marginal standard deviations of log e, (B, K, C); None without a room."""
        return self.split(self._marginal_variance_bn)[2].sqrt() if self.num_components else None

    @property
    def _marginal_variance_bn(self) -> Tensor:
        return self.scale_bn.square() + self.factor_bnr.square().sum(-1)

    def clip(self, b: int) -> "UnconstrainedGaussian":
        """The Gaussian of one clip, still with an axis of clips."""
        clip = slice(b, b + 1)
        return replace(self, loc_bn=self.loc_bn[clip], scale_bn=self.scale_bn[clip], factor_bnr=self.factor_bnr[clip])

    @staticmethod
    def stack(clips: Sequence["UnconstrainedGaussian"]) -> "UnconstrainedGaussian":
        """The Gaussians of several clips as one."""
        return replace(
            clips[0],
            loc_bn=torch.cat([clip.loc_bn for clip in clips]),
            scale_bn=torch.cat([clip.scale_bn for clip in clips]),
            factor_bnr=torch.cat([clip.factor_bnr for clip in clips]),
        )

    def sites_of(self, latent_bn: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        """Values of the model's sites at latents (..., B, N), and the log Jacobian (..., B)."""
        log_w_bkd, stick_bk, log_e_bkc = self.split(latent_bn)
        # Its density needs the sticks, which the levels of nearly empty classes do not determine.
        stick_breaking = transforms.StickBreakingTransform(cache_size=1)
        pi_bk = stick_breaking(stick_bk)
        jacobian_b = log_w_bkd.flatten(-2).sum(-1) + stick_breaking.log_abs_det_jacobian(stick_bk, pi_bk)
        sites = {"direction_weights": log_w_bkd.exp(), "mixing_levels": pi_bk}
        if not self.num_components:
            return sites, jacobian_b
        return {**sites, "diffuse_weights": log_e_bkc.exp()}, jacobian_b + log_e_bkc.flatten(-2).sum(-1)

    def sample_sites(self) -> None:
        """Samples the sites in Pyro, each given those before it; the plate of clips is the caller's."""
        w_bkd = pyro.sample("direction_weights", self.direction_posterior())
        levels = self.level_posterior(w_bkd)
        pi_bk = pyro.sample("mixing_levels", levels)
        if self.num_components:
            pyro.sample("diffuse_weights", self.diffuse_posterior(w_bkd, levels.transforms[0].inv(pi_bk)))

    def direction_posterior(self) -> TorchDistribution:
        """q(w), batch_shape (B,), event_shape (K, D)."""
        if not self.factor_bnr.shape[-1]:
            # The same distribution in a form for which torch has the divergence from a log-normal prior.
            return dist.LogNormal(self.mu_bkd, self.sigma_bkd).to_event(2)
        n, shape = self.num_weights, self.mu_bkd.shape[-2:]
        log_w = dist.LowRankMultivariateNormal(
            self.loc_bn[..., :n], self.factor_bnr[..., :n, :], self.scale_bn[..., :n].square()
        )
        return _log_weights(log_w, shape)

    def level_posterior(self, w_bkd: Tensor) -> dist.TransformedDistribution:
        """q(pi | w), batch_shape (B,), event_shape (K,)."""
        # Its density needs the sticks, which the levels of nearly empty classes do not determine.
        stick_breaking = transforms.StickBreakingTransform(cache_size=1)
        sticks = self._next(w_bkd.log().flatten(-2), self.num_sources - 1)
        return dist.TransformedDistribution(sticks, [stick_breaking])

    def diffuse_posterior(self, w_bkd: Tensor, stick_bk: Tensor) -> TorchDistribution:
        """q(e | w, pi), batch_shape (B,), event_shape (K, C), with pi given by its sticks (B, K - 1)."""
        log_w_bn = w_bkd.log().flatten(-2)
        log_e = self._next(torch.cat([log_w_bn, stick_bk], dim=-1), self.num_diffuse)
        shape = torch.Size((self.num_sources, self.num_components))
        if not self.factor_bnr.shape[-1]:
            # As for q(w).
            loc_bn, scale_bn = log_e.base_dist.loc, log_e.base_dist.scale.expand_as(log_e.base_dist.loc)
            return dist.LogNormal(loc_bn.unflatten(-1, shape), scale_bn.unflatten(-1, shape)).to_event(2)
        return _log_weights(log_e, shape)

    def _next(self, known_bn: Tensor, size: int) -> TorchDistribution:
        """The normal distribution of the latents that follow known ones, event_shape (size,).

        With precision A = I + F^T S^-2 F of the known latents' F and S, the shared factors given their values v are
        N(A^-1 F^T S^-2 (v - mu), A^-1).
        """
        n = known_bn.shape[-1]
        loc_bn, scale_bn = self.loc_bn[..., n : n + size], self.scale_bn[..., n : n + size]
        factor_bnr = self.factor_bnr[..., n : n + size, :]
        if not factor_bnr.shape[-1]:
            return dist.Normal(loc_bn.expand(*known_bn.shape[:-1], -1), scale_bn).to_event(1)
        loading_bnr = self.factor_bnr[..., :n, :] / self.scale_bn[..., :n, None]
        standardised_bn = (known_bn - self.loc_bn[..., :n]) / self.scale_bn[..., :n]
        precision_brr = loading_bnr.mT @ loading_bnr + torch.eye(loading_bnr.shape[-1]).to(loading_bnr)
        covariance_brr = torch.cholesky_inverse(torch.linalg.cholesky(precision_brr))
        projected_br1 = loading_bnr.mT @ standardised_bn[..., None]
        mean_bn = loc_bn + (factor_bnr @ covariance_brr @ projected_br1).squeeze(-1)
        # L L^T = A^-1, so that F L stands in for the factors' own loadings.
        left_bnr = factor_bnr @ torch.linalg.cholesky(covariance_brr)
        variance_bn = scale_bn.square().expand_as(mean_bn)
        return dist.LowRankMultivariateNormal(mean_bn, left_bnr.expand(*mean_bn.shape, -1), variance_bn)


def _log_weights(log_weights: TorchDistribution, shape: torch.Size) -> TorchDistribution:
    """Positive weights of the given event shape whose logarithms have the given distribution, flattened."""
    reshape = transforms.ReshapeTransform(log_weights.event_shape, shape)
    return dist.TransformedDistribution(log_weights, [transforms.ExpTransform(), reshape])


def log_normal_and_dirichlet(
    mu_bkd: Tensor,
    sigma_bkd: Tensor,
    concentration_bk: Tensor,
    diffuse_mu_bkc: Tensor | None = None,
    diffuse_sigma_bkc: Tensor | None = None,
) -> UnconstrainedGaussian:
    """The Gaussian with the moments of log-normal w and e and of pi ~ Dir(concentration) in unconstrained space.

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
    locs, scales = [mu_bkd.flatten(-2), logit_bk + offset_k], [sigma_bkd.flatten(-2), spread_bk]
    num_components = 0
    if diffuse_mu_bkc is not None and diffuse_sigma_bkc is not None:
        num_components = diffuse_mu_bkc.shape[-1]
        locs.append(diffuse_mu_bkc.flatten(-2))
        scales.append(diffuse_sigma_bkc.flatten(-2))
    loc_bn, scale_bn = torch.cat(locs, dim=-1), torch.cat(scales, dim=-1).clamp(LEAST_SCALE, MOST_SCALE)
    return UnconstrainedGaussian(loc_bn, scale_bn, loc_bn.new_zeros(*loc_bn.shape, 0), num_sources, num_components)

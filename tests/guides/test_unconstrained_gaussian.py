"""Gaussians of the unconstrained latents: the two sites are drawn and weighed as the one Gaussian behind them."""

import pytest
import torch
from pyro import distributions as dist

from avssl_pyro.guides.unconstrained_gaussian import UnconstrainedGaussian, log_normal_and_dirichlet

B, K, D, R = 2, 3, 4, 2
N = K * D + K - 1


@pytest.fixture
def gaussian() -> UnconstrainedGaussian:
    torch.manual_seed(0)
    factor_bnr = 0.5 * torch.randn(B, N, R, dtype=torch.float64)
    loc_bn, scale_bn = torch.randn(B, N).double(), 0.2 + torch.rand(B, N).double()
    return UnconstrainedGaussian(loc_bn, scale_bn, factor_bnr, K)


@pytest.mark.parametrize("rank", [0, R])
def test_the_sites_are_drawn_with_the_joint_covariance_and_density(gaussian: UnconstrainedGaussian, rank: int) -> None:
    gaussian = UnconstrainedGaussian(gaussian.loc_bn, gaussian.scale_bn, gaussian.factor_bnr[..., :rank], K)
    w_sbkd = gaussian.direction_posterior().sample((40000,))
    levels = gaussian.level_posterior(w_sbkd)
    level_sbk = levels.sample()
    (stick_breaking,) = levels.transforms
    stick_sbk = stick_breaking.inv(level_sbk)
    latent_sbn = torch.cat([w_sbkd.log().flatten(-2), stick_sbk], dim=-1)
    covariance_bnn = gaussian.factor_bnr @ gaussian.factor_bnr.mT + torch.diag_embed(gaussian.scale_bn.square())
    for b in range(B):
        torch.testing.assert_close(torch.cov(latent_sbn[:, b].T), covariance_bnn[b], rtol=0.05, atol=0.05)
    joint = dist.MultivariateNormal(gaussian.loc_bn, covariance_bnn)
    jacobian_sb = w_sbkd.log().sum((-2, -1)) + stick_breaking.log_abs_det_jacobian(stick_sbk, level_sbk)
    found_sb = gaussian.direction_posterior().log_prob(w_sbkd) + levels.log_prob(level_sbk) + jacobian_sb
    torch.testing.assert_close(found_sb, joint.log_prob(latent_sbn), rtol=1e-6, atol=1e-6)


def test_marginal_spread_counts_what_is_shared(gaussian: UnconstrainedGaussian) -> None:
    drawn_bkd = gaussian.direction_posterior().sample((40000,)).log().std(0)
    torch.testing.assert_close(drawn_bkd, gaussian.sigma_bkd, rtol=0.02, atol=0.0)


def test_sticks_of_a_dirichlet_have_its_moments() -> None:
    torch.manual_seed(0)
    mu_bkd, concentration_bk = torch.zeros(B, K, D), torch.tensor([[30.0, 40.0, 50.0], [40.0, 20.0, 70.0]])
    gaussian = log_normal_and_dirichlet(mu_bkd, mu_bkd + 0.3, concentration_bk)
    drawn_sbk = gaussian.level_posterior(mu_bkd.exp().expand(20000, -1, -1, -1)).sample()
    exact = dist.Dirichlet(concentration_bk)
    torch.testing.assert_close(drawn_sbk.mean(0), exact.mean, rtol=0.02, atol=0.0)
    torch.testing.assert_close(drawn_sbk.var(0), exact.variance, rtol=0.1, atol=0.0)


def test_clips_are_parted_and_stacked_again(gaussian: UnconstrainedGaussian) -> None:
    again = UnconstrainedGaussian.stack([gaussian.clip(b) for b in range(B)])
    for name in ("loc_bn", "scale_bn", "factor_bnr"):
        torch.testing.assert_close(getattr(again, name), getattr(gaussian, name))

"""Gaussians of the unconstrained latents: the two sites are drawn and weighed as the one Gaussian behind them."""

from dataclasses import replace

import pyro
import pytest
import torch
from pyro import distributions as dist
from torch.distributions import transforms

from avssl_pyro.guides.unconstrained_gaussian import UnconstrainedGaussian, log_normal_and_dirichlet

B, K, D, C, R = 2, 3, 4, 2, 2
N = K * D + K - 1


def make(components: int) -> UnconstrainedGaussian:
    torch.manual_seed(0)
    n = N + K * components
    factor_bnr = 0.5 * torch.randn(B, n, R, dtype=torch.float64)
    loc_bn, scale_bn = torch.randn(B, n).double(), 0.2 + torch.rand(B, n).double()
    return UnconstrainedGaussian(loc_bn, scale_bn, factor_bnr, K, components)


@pytest.fixture(params=[0, C], ids=["no room", "room"])
def gaussian(request: pytest.FixtureRequest) -> UnconstrainedGaussian:
    return make(request.param)


@pytest.mark.parametrize("rank", [0, R])
def test_the_sites_are_drawn_with_the_joint_covariance_and_density(gaussian: UnconstrainedGaussian, rank: int) -> None:
    gaussian = replace(gaussian, factor_bnr=gaussian.factor_bnr[..., :rank])
    w_sbkd = gaussian.direction_posterior().sample((40000,))
    levels = gaussian.level_posterior(w_sbkd)
    level_sbk = levels.sample()
    (stick_breaking,) = levels.transforms
    stick_sbk = stick_breaking.inv(level_sbk)
    latents = [w_sbkd.log().flatten(-2), stick_sbk]
    found_sb = gaussian.direction_posterior().log_prob(w_sbkd) + levels.log_prob(level_sbk)
    if gaussian.num_components:
        diffuse = gaussian.diffuse_posterior(w_sbkd, stick_sbk)
        e_sbkc = diffuse.sample()
        assert e_sbkc.shape[1:] == (B, K, C)
        latents.append(e_sbkc.log().flatten(-2))
        found_sb = found_sb + diffuse.log_prob(e_sbkc)
    latent_sbn = torch.cat(latents, dim=-1)
    covariance_bnn = gaussian.factor_bnr @ gaussian.factor_bnr.mT + torch.diag_embed(gaussian.scale_bn.square())
    for b in range(B):
        torch.testing.assert_close(torch.cov(latent_sbn[:, b].T), covariance_bnn[b], rtol=0.05, atol=0.05)
    joint = dist.MultivariateNormal(gaussian.loc_bn, covariance_bnn)
    sites, jacobian_sb = gaussian.sites_of(latent_sbn)
    torch.testing.assert_close(found_sb + jacobian_sb, joint.log_prob(latent_sbn), rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(sites["mixing_levels"], level_sbk)
    torch.testing.assert_close(sites["direction_weights"], w_sbkd)


@pytest.mark.parametrize("rank", [0, R])
def test_traced_sites_have_the_density_of_the_gaussian(gaussian: UnconstrainedGaussian, rank: int) -> None:
    gaussian = replace(gaussian, factor_bnr=gaussian.factor_bnr[..., :rank])
    with pyro.poutine.trace() as tracer, pyro.plate("draws", 5, dim=-2), pyro.plate("clip", B, dim=-1):
        gaussian.sample_sites()
    nodes, covariance_bnn = tracer.trace.nodes, torch.diag_embed(gaussian.scale_bn.square())
    if rank:
        covariance_bnn = covariance_bnn + gaussian.factor_bnr @ gaussian.factor_bnr.mT
    stick_sbk = transforms.StickBreakingTransform().inv(nodes["mixing_levels"]["value"])
    latents = [nodes["direction_weights"]["value"].log().flatten(-2).expand(5, B, -1), stick_sbk]
    if gaussian.num_components:
        latents.append(nodes["diffuse_weights"]["value"].log().flatten(-2))
    latent_sbn = torch.cat(latents, dim=-1)
    joint_sb = dist.MultivariateNormal(gaussian.loc_bn, covariance_bnn).log_prob(latent_sbn)
    expected = joint_sb - gaussian.sites_of(latent_sbn)[1]
    torch.testing.assert_close(tracer.trace.log_prob_sum(), expected.sum(), rtol=1e-6, atol=1e-6)


def test_marginal_spread_counts_what_is_shared(gaussian: UnconstrainedGaussian) -> None:
    drawn_bkd = gaussian.direction_posterior().sample((40000,)).log().std(0)
    torch.testing.assert_close(drawn_bkd, gaussian.sigma_bkd, rtol=0.02, atol=0.0)


def test_marginals_of_diffuse_weights() -> None:
    gaussian = make(C)
    w_sbkd = gaussian.direction_posterior().sample((40000,))
    levels = gaussian.level_posterior(w_sbkd)
    stick_sbk = levels.transforms[0].inv(levels.sample())
    log_e_sbkc = gaussian.diffuse_posterior(w_sbkd, stick_sbk).sample().log()
    torch.testing.assert_close(log_e_sbkc.mean(0), gaussian.diffuse_mu_bkc, rtol=0.0, atol=0.03)
    torch.testing.assert_close(log_e_sbkc.std(0), gaussian.diffuse_sigma_bkc, rtol=0.02, atol=0.0)
    assert make(0).diffuse_mu_bkc is None


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

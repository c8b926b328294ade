"""Predictive checks: a model passes on what it made itself and fails on what it cannot make."""

import numpy as np
import pytest
import torch
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.criticism.predictive import BeamPower, Coherence, Statistic, predictive_check
from avssl_pyro.distributions.spatial_mixture import SpatialMixture
from avssl_pyro.guides.initializers import UninformedInitializer
from avssl_pyro.guides.posterior_draws import PosteriorDraws, draw_from, draw_log_likelihoods, prior_draws, replicate
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.models.likelihoods import FrameActivity, InverseGammaPsd
from avssl_pyro.models.priors import LogNormalWeights, SymmetricDirichlet
from avssl_pyro.models.spatial_cgmm import SpatialCGMM

K, D, F, T = 2, 12, 8, 30
FREQUENCIES = np.linspace(400.0, 3000.0, F)
STEERING_FDM = FreeField(PRESETS["circle4"])(DirectionGrid(D), FREQUENCIES).to(torch.complex64)
MODEL = SpatialCGMM(STEERING_FDM, K, SymmetricDirichlet(1.0), LogNormalWeights(1.0), bin_weight=2.0)
IMAGE_CIJ = torch.zeros(3, 1, 1)
EMPTY_FMT = torch.zeros(F, 4, T, dtype=torch.complex64)
STATISTICS = pytest.mark.parametrize("statistic", [BeamPower(STEERING_FDM), Coherence(STEERING_FDM)])


@pytest.fixture
def truth() -> PosteriorDraws:
    """A source at direction 3, a quieter one at direction 9."""
    w_kd = torch.full((K, D), 0.02)
    w_kd[0, 3] = w_kd[1, 9] = 5.0
    return PosteriorDraws(w_kd[None], torch.tensor([[0.7, 0.3]]))


@pytest.fixture
def x_fmt(truth: PosteriorDraws) -> Tensor:
    return replicate(MODEL, EMPTY_FMT, IMAGE_CIJ, truth, seed=5)[0]


@STATISTICS
def test_the_truth_replicates_its_own_recording(truth: PosteriorDraws, x_fmt: Tensor, statistic: Statistic) -> None:
    copies = PosteriorDraws(truth.w_skd.expand(100, -1, -1), truth.pi_sk.expand(100, -1))
    check = predictive_check(MODEL, x_fmt, IMAGE_CIJ, copies, statistic, seed=1)
    assert check.p_value > 0.02
    assert ((check.p_values_p > 0.005) & (check.p_values_p < 0.995)).all()


def test_a_posterior_replicates_the_recording_better_than_the_prior(x_fmt: Tensor) -> None:
    refined = RefinedGuide(UninformedInitializer(K, DirectionGrid(D)), MODEL, RefinementConfig(softening=1.0))
    posterior = draw_from(refined, x_fmt, IMAGE_CIJ, 60)
    prior = prior_draws(MODEL, x_fmt, IMAGE_CIJ, 60)
    checks = [predictive_check(MODEL, x_fmt, IMAGE_CIJ, draws, BeamPower(STEERING_FDM)) for draws in (posterior, prior)]
    errors = [(check.replicated_sp - check.observed_p).square().mean().item() for check in checks]
    assert errors[0] < 0.2 * errors[1]
    assert checks[0].replicated_sp.mean(0).argmax() == 3


@STATISTICS
def test_what_the_model_cannot_make_is_seen(truth: PosteriorDraws, statistic: Statistic) -> None:
    """Microphones that share nothing, against a model of two narrow sources."""
    torch.manual_seed(0)
    noise_fmt = torch.randn(F, 4, T, dtype=torch.complex64)
    copies = PosteriorDraws(truth.w_skd.expand(60, -1, -1), truth.pi_sk.expand(60, -1))
    assert predictive_check(MODEL, noise_fmt, IMAGE_CIJ, copies, statistic).p_value == 0.0


@STATISTICS
def test_statistics_know_nothing_of_power(x_fmt: Tensor, statistic: Statistic) -> None:
    louder_fmt = x_fmt * torch.linspace(0.1, 10.0, F * T).reshape(F, 1, T)
    torch.testing.assert_close(statistic(louder_fmt), statistic(x_fmt), rtol=1e-4, atol=1e-5)


def test_the_log_likelihood_is_that_of_the_distribution_as_the_model_weighs_it(x_fmt: Tensor) -> None:
    draws = prior_draws(MODEL, x_fmt, IMAGE_CIJ, 5)
    mixture = SpatialMixture(MODEL.template_dfmm, draws.w_skd, draws.pi_sk, num_frames=T, diffuse=MODEL.diffuse)
    torch.testing.assert_close(draw_log_likelihoods(MODEL, x_fmt, IMAGE_CIJ, draws), 2.0 * mixture.log_prob(x_fmt))


def test_prior_draws_are_those_of_the_priors_and_come_again_by_their_seed(x_fmt: Tensor) -> None:
    draws = prior_draws(MODEL, x_fmt, IMAGE_CIJ, 2000, seed=3)
    assert draws.w_skd.shape == (2000, K, D)
    log_w_skd = draws.w_skd.log()
    assert log_w_skd.mean().item() == pytest.approx(0.0, abs=0.02)
    assert log_w_skd.std().item() == pytest.approx(1.0, abs=0.02)
    assert draws.pi_sk.std().item() == pytest.approx(12**-0.5, abs=0.01)
    assert torch.equal(prior_draws(MODEL, x_fmt, IMAGE_CIJ, 2000, seed=3).w_skd, draws.w_skd)


@pytest.mark.parametrize("likelihood", [InverseGammaPsd(0.8, 0.1), FrameActivity(0.3, most_active=1)], ids=str)
def test_replicas_are_made_by_the_likelihood_of_the_model(
    truth: PosteriorDraws, likelihood: InverseGammaPsd | FrameActivity
) -> None:
    model = SpatialCGMM(STEERING_FDM, K, likelihood=likelihood)
    replica_fmt, usual_fmt = (replicate(each, EMPTY_FMT, IMAGE_CIJ, truth, seed=3)[0] for each in (model, MODEL))
    assert replica_fmt.shape == usual_fmt.shape
    if isinstance(likelihood, InverseGammaPsd):
        # Powers of bins differ by orders of magnitude, not only by the directions they come from.
        spreads = [each.abs().square().sum(1).log().std() for each in (replica_fmt, usual_fmt)]
        assert spreads[0] > 1.5 * spreads[1]
    else:
        # One class a frame: a frame's bins have the masks of one class.
        w_kd = truth.w_skd[0]
        mixture = likelihood(MODEL.template_dfmm, w_kd[None], truth.pi_sk, T, MODEL.diffuse)
        active_kt = mixture.active(replica_fmt[None])[0]
        assert active_kt.amax(0).min() > 0.9

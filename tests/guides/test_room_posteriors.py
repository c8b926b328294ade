"""Posteriors of a model with a room: fitted, sampled and drawn with its third site, from any start."""

import numpy as np
import pyro
import pytest
import torch
from pyro.infer import Trace_ELBO
from torch import Tensor, nn

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.room_templates import SensorNoise
from avssl_pyro.errors import InputError
from avssl_pyro.guides.base import GuideParameters
from avssl_pyro.guides.diffuse_start import num_components_of, start_for
from avssl_pyro.guides.gaussian_families import GaussianFamily, LowRank, MeanField
from avssl_pyro.guides.initializers import UninformedInitializer
from avssl_pyro.guides.nuts import NutsConfig, NutsDraws, NutsGuide, sample_posterior
from avssl_pyro.guides.per_clip import PerClipConfig, PerClipGuide
from avssl_pyro.guides.posterior_draws import draw_from, draw_log_likelihoods, replicate
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.models.likelihoods import Likelihood, PrecedenceGaussian, ProfiledGaussian
from avssl_pyro.models.priors import SymmetricDirichlet
from avssl_pyro.models.room import ROOM_DIFFUSE, Room
from avssl_pyro.models.spatial_cgmm import SpatialCGMM

K, D, C, F, T = 2, 8, 2, 6, 24
ARRAY, GRID, FREQUENCIES = PRESETS["circle4"], DirectionGrid(D), np.linspace(500.0, 3000.0, F)
ROOM = Room.of_array(ARRAY, GRID, FREQUENCIES)
STEERING_FDM = ARRAY.steering_vectors(GRID, FREQUENCIES)
IMAGE_BCIJ = torch.zeros(1, 3, 1, 1)
QUICK = NutsConfig(draws=5, warmup=5, chains=2)
FAMILIES = pytest.mark.parametrize("family", [MeanField(), LowRank(3)], ids=["mean-field", "low-rank"])


def make_model(likelihood: Likelihood = ProfiledGaussian(), room: Room | None = ROOM) -> SpatialCGMM:  # noqa: B008
    return SpatialCGMM(STEERING_FDM, K, SymmetricDirichlet(1.0), diffuse=ROOM_DIFFUSE, likelihood=likelihood, room=room)


def make_start(model: SpatialCGMM) -> RefinedGuide:
    config = RefinementConfig(rounds=200, tolerance=1e-6)
    return RefinedGuide(UninformedInitializer(K, GRID).double(), model, config)


class WithoutDiffuse(nn.Module):
    """A guide written before there were rooms."""

    def __init__(self, start: RefinedGuide) -> None:
        super().__init__()
        self.start = start

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        return GuideParameters(*self.start.parameters_of(x_bfmt, image_bcij)[:4])


@pytest.fixture
def x_bfmt() -> Tensor:
    """Two talkers who take turns, in noise of the microphones."""
    torch.manual_seed(0)
    talker_jbft = torch.randn(2, 1, F, T, dtype=torch.complex128) * (torch.rand(2, 1, F, T) < 0.5)
    talkers_bfmt = sum(
        STEERING_FDM[None, :, d, :, None] * talker_bft[:, :, None]
        for d, talker_bft in zip((1, 5), talker_jbft, strict=True)
    )
    return talkers_bfmt + 0.4 * torch.randn(1, F, 4, T, dtype=torch.complex128)


@pytest.mark.parametrize("likelihood", [ProfiledGaussian(), PrecedenceGaussian()], ids=str)
def test_nuts_and_refinement_agree(likelihood: Likelihood, x_bfmt: Tensor) -> None:
    model = make_model(likelihood)
    start = make_start(model)
    refined = start.parameters_of(x_bfmt, IMAGE_BCIJ)
    draws = sample_posterior(start, model, x_bfmt[0], IMAGE_BCIJ[0], NutsConfig(draws=80, warmup=60, chains=1))
    assert draws.diverging_s.sum() <= 2
    assert draws.e_skc is not None and refined.diffuse_mu_bkc is not None and refined.diffuse_sigma_bkc is not None
    # The likelihood is one of ratios; the scale of a class is the prior's alone.
    ratio_sk = draws.e_skc.sum(-1).log() - draws.w_skd.sum(-1).log()
    refined_ratio_k = refined.diffuse_mu_bkc[0].logsumexp(-1) - refined.mu_bkd[0].logsumexp(-1)
    torch.testing.assert_close(refined_ratio_k, ratio_sk.mean(0), rtol=0, atol=0.25)
    level_k = refined.concentration_bk[0] / refined.concentration_bk[0].sum()
    torch.testing.assert_close(level_k, draws.pi_sk.mean(0), rtol=0, atol=0.04)
    moments = draws.diffuse_moments()
    assert moments is not None
    of_e = zip((refined.diffuse_mu_bkc[0], refined.diffuse_sigma_bkc[0]), moments, (0.6, 0.7), strict=True)
    for found_kc, expected_kc, tolerance in of_e:
        torch.testing.assert_close(found_kc, expected_kc, rtol=0, atol=tolerance)


@FAMILIES
def test_a_fit_by_gradients_has_the_third_site_and_raises_the_elbo(family: GaussianFamily, x_bfmt: Tensor) -> None:
    model = make_model()
    start = make_start(model)
    fitted = PerClipGuide(start, model, family).fitted_to(x_bfmt, IMAGE_BCIJ)
    known = fitted.parameters_of(x_bfmt, IMAGE_BCIJ)
    assert known.diffuse_mu_bkc is not None and known.diffuse_mu_bkc.shape == (1, K, C)
    trace = pyro.poutine.trace(fitted).get_trace(x_bfmt, IMAGE_BCIJ)
    assert trace.stochastic_nodes == ["clip", "direction_weights", "mixing_levels", "diffuse_weights"]
    estimator = Trace_ELBO(num_particles=200, vectorize_particles=True, max_plate_nesting=1)
    with torch.no_grad():
        before, after = (estimator.loss(model, guide, x_bfmt, IMAGE_BCIJ) for guide in (start, fitted))
    assert after < before


class DiffuseFirst(SpatialCGMM):
    """The same model, its sites in the opposite order."""

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:  # noqa: ARG002
        assert self.room is not None
        like = self.template_pairs
        with pyro.plate("clip", len(x_bfmt), dim=-1):
            e_bkc = pyro.sample("diffuse_weights", self.room.prior(K, like))
            pi_bk = pyro.sample("mixing_levels", self.level_prior(K, like))
            w_bkd = pyro.sample("direction_weights", self.direction_prior(K, D, like))
            of_x = self.likelihood(self.template_dfmm, torch.cat([w_bkd, e_bkc], -1), pi_bk, T, self.diffuse)
            pyro.sample("spectrogram", of_x, obs=x_bfmt)


@FAMILIES
def test_a_model_may_draw_its_three_sites_in_any_order(family: GaussianFamily, x_bfmt: Tensor) -> None:
    model = DiffuseFirst(STEERING_FDM, K, SymmetricDirichlet(1.0), diffuse=ROOM_DIFFUSE, room=ROOM)
    start = make_start(model)
    known = start.parameters_of(x_bfmt, IMAGE_BCIJ)
    # After one tiny step the fit still is its start, if every latent is in its place.
    config = PerClipConfig(steps=1, learning_rate=1e-6)
    found = PerClipGuide(start, model, family, config).parameters_of(x_bfmt, IMAGE_BCIJ)
    torch.testing.assert_close(found.mu_bkd, known.mu_bkd, rtol=0, atol=1e-4)
    torch.testing.assert_close(found.diffuse_mu_bkc, known.diffuse_mu_bkc, rtol=0, atol=1e-4)


def test_starts_without_diffuse_weights_get_their_share(x_bfmt: Tensor) -> None:
    model = make_model()
    start = WithoutDiffuse(make_start(model))
    known = start.parameters_of(x_bfmt, IMAGE_BCIJ)
    whole = start_for(model, known, x_bfmt, IMAGE_BCIJ)
    assert whole.diffuse_mu_bkc is not None and whole.diffuse_sigma_bkc is not None
    share_bkj = torch.cat([whole.mu_bkd, whole.diffuse_mu_bkc], -1).softmax(-1)
    torch.testing.assert_close(share_bkj[..., D:].sum(-1), torch.full((1, K), 0.08).double())
    assert whole.diffuse_sigma_bkc.min() > 0
    for guide in (PerClipGuide(start, model, config=PerClipConfig(steps=2)), NutsGuide(start, model, QUICK)):
        fitted = guide.parameters_of(x_bfmt, IMAGE_BCIJ)
        assert fitted.diffuse_mu_bkc is not None and fitted.diffuse_mu_bkc.shape == (1, K, C)
        assert fitted.diffuse_sigma_bkc is not None and fitted.diffuse_sigma_bkc.min() > 0


def test_starts_with_diffuse_weights_lose_them_without_a_room(x_bfmt: Tensor) -> None:
    plain, start = make_model(room=None), make_start(make_model())
    assert num_components_of(plain, x_bfmt, IMAGE_BCIJ) == 0
    for guide in (PerClipGuide(start, plain, config=PerClipConfig(steps=2)), NutsGuide(start, plain, QUICK)):
        trace = pyro.poutine.trace(guide).get_trace(x_bfmt, IMAGE_BCIJ)
        assert trace.stochastic_nodes == ["clip", "direction_weights", "mixing_levels"]


def test_another_number_of_components_is_refused(x_bfmt: Tensor) -> None:
    other = make_model(room=Room.of_array(ARRAY, GRID, FREQUENCIES, components=(SensorNoise(),)))
    with pytest.raises(InputError, match="the start has 2 diffuse components and the room of the model 1"):
        PerClipGuide(make_start(make_model()), other).fitted_to(x_bfmt, IMAGE_BCIJ)


def test_draws_of_nuts_go_to_arviz(x_bfmt: Tensor) -> None:
    model = make_model()
    draws = sample_posterior(make_start(model), model, x_bfmt[0], IMAGE_BCIJ[0], QUICK)
    assert isinstance(draws, NutsDraws)
    posterior = draws.to_arviz().posterior
    assert posterior["diffuse_weights"].dims == ("chain", "draw", "source", "component")
    assert dict(posterior.sizes) == {"chain": 2, "draw": 5, "source": K, "direction": D, "component": C}
    assert draws.thinned(5).float().e_skc is not None


@pytest.mark.parametrize("likelihood", [ProfiledGaussian(), PrecedenceGaussian()], ids=str)
def test_draws_are_weighed_and_replicated(likelihood: Likelihood, x_bfmt: Tensor) -> None:
    model = make_model(likelihood)
    draws = draw_from(make_start(model), x_bfmt[0], IMAGE_BCIJ[0], 4)
    assert draws.e_skc is not None and draws.e_skc.shape == (4, K, C)
    weight_skj = torch.cat([draws.w_skd, draws.e_skc], -1)
    expected_s = torch.stack(
        [
            likelihood(model.template_dfmm, weight_kj[None], pi_k[None], T, model.diffuse).log_prob(x_bfmt)[0]
            for weight_kj, pi_k in zip(weight_skj, draws.pi_sk, strict=True)
        ]
    )
    torch.testing.assert_close(draw_log_likelihoods(model, x_bfmt[0], IMAGE_BCIJ[0], draws), expected_s)
    replicas_sfmt = replicate(model, x_bfmt[0], IMAGE_BCIJ[0], draws)
    assert replicas_sfmt.shape == (4, F, 4, T)
    # Weighing bins changes nothing in what a bin is.
    torch.testing.assert_close(replicas_sfmt, replicate(make_model(), x_bfmt[0], IMAGE_BCIJ[0], draws))

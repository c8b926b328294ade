"""The model with a room: its ascent never falls, its ELBO is the closed form, guides supply its site."""

import math

import numpy as np
import pyro
import pyro.distributions as dist
import pytest
import torch
from pyro.infer import Trace_ELBO, TraceEnum_ELBO, TraceMeanField_ELBO
from torch import Tensor, nn

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.room_templates import IsotropicField, SensorNoise, elevated_templates
from avssl_pyro.criticism.closed_form import kl_dirichlet, room_log_likelihood
from avssl_pyro.distributions.precedence import log_decay_of, precedence_weights
from avssl_pyro.distributions.profiled_gaussian import observe
from avssl_pyro.errors import InputError
from avssl_pyro.guides.base import FixedGuide
from avssl_pyro.guides.conjugacy import map_em_of
from avssl_pyro.guides.diffuse_start import with_diffuse_start
from avssl_pyro.guides.initializers import UninformedInitializer
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.models.explicit_masks import ExplicitMaskCGMM
from avssl_pyro.models.likelihoods import Likelihood, PrecedenceGaussian, ProfiledGaussian
from avssl_pyro.models.priors import SparseDirichlet
from avssl_pyro.models.room import ROOM_DIFFUSE, Room
from avssl_pyro.models.spatial_cgmm import SpatialCGMM

B, K, D, C, F, T = 2, 3, 24, 2, 10, 16
ARRAY, GRID, FREQUENCIES = PRESETS["circle4"], DirectionGrid(D), np.linspace(300.0, 4000.0, F)
ROOM = Room.of_array(ARRAY, GRID, FREQUENCIES)
STEERING_FDM = ARRAY.steering_vectors(GRID, FREQUENCIES)
IMAGE_BCIJ = torch.zeros(B, 3, 4, 8)
ALPHA = 0.3
LIKELIHOODS: list[Likelihood] = [ProfiledGaussian(), PrecedenceGaussian()]


@pytest.fixture
def x_bfmt() -> Tensor:
    """A talker in noise."""
    torch.manual_seed(0)
    talker_bft = torch.randn(B, F, T, dtype=torch.complex128)
    noise_bfmt = torch.randn(B, F, ARRAY.num_microphones, T, dtype=torch.complex128)
    return STEERING_FDM[None, :, 5, :, None] * talker_bft[:, :, None] + 0.3 * noise_bfmt


def make_model(likelihood: Likelihood, dtype: torch.dtype = torch.complex128) -> SpatialCGMM:
    return SpatialCGMM(
        STEERING_FDM.to(dtype), K, SparseDirichlet(ALPHA), diffuse=ROOM_DIFFUSE, likelihood=likelihood, room=ROOM
    )


class PointLike(nn.Module):
    """q(w), q(e) log-normal and q(pi) Dirichlet, with parameters common to all clips."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(1)
        self.mu_kd = nn.Parameter(torch.randn(K, D, dtype=torch.float64))
        self.mu_kc = nn.Parameter(torch.randn(K, C, dtype=torch.float64))
        self.concentration_k = nn.Parameter(torch.rand(K, dtype=torch.float64) + 2)

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:  # noqa: ARG002
        with pyro.plate("clip", B, dim=-1):
            pyro.sample("direction_weights", dist.LogNormal(self.mu_kd, 0.3).to_event(2))
            pyro.sample("mixing_levels", dist.Dirichlet(self.concentration_k))
            pyro.sample("diffuse_weights", dist.LogNormal(self.mu_kc, 0.2).to_event(2))


def closed_form_loss(guide: PointLike, x_bfmt: Tensor, likelihood: Likelihood, analytic: bool) -> Tensor:
    """Draws as Pyro does, KL terms by hand or as log-ratios of the draws."""
    w_bkd = torch.exp(guide.mu_kd + 0.3 * torch.randn(B, K, D, dtype=torch.float64))
    pi_bk = torch.distributions.Dirichlet(guide.concentration_k.expand(B, K)).rsample()
    e_bkc = torch.exp(guide.mu_kc + 0.2 * torch.randn(B, K, C, dtype=torch.float64))
    weight_bft = None
    if isinstance(likelihood, PrecedenceGaussian):
        weight_bft = precedence_weights(observe(x_bfmt), log_decay_of(0.5, 0.01), 0.05)
    log_likelihood_b = room_log_likelihood(
        x_bfmt, ROOM.direction_dfmm, ROOM.diffuse_cfmm, w_bkd, e_bkc, pi_bk, ROOM_DIFFUSE, weight_bft
    )
    if analytic:
        kl_w = (0.5 * (guide.mu_kd**2 + 0.3**2 - 1) - math.log(0.3)).sum()
        kl_e = (((guide.mu_kc - 2) ** 2 + 0.2**2 - 4) / 8 + math.log(2 / 0.2)).sum()
        return B * (kl_w + kl_e) + (kl_dirichlet(guide.concentration_k.expand(B, K), ALPHA) - log_likelihood_b).sum()
    kl = torch.zeros((), dtype=torch.float64)
    for log_v, mu, sigma, prior_mu, prior_sigma in (
        (w_bkd.log(), guide.mu_kd, 0.3, 0.0, 1.0),
        (e_bkc.log(), guide.mu_kc, 0.2, 2.0, 2.0),
    ):
        log_q = -0.5 * ((log_v - mu) / sigma) ** 2 - math.log(sigma)
        kl = kl + (log_q + 0.5 * ((log_v - prior_mu) / prior_sigma) ** 2 + math.log(prior_sigma)).sum()
    prior = torch.distributions.Dirichlet(torch.full((K,), ALPHA, dtype=torch.float64))
    kl = kl + (torch.distributions.Dirichlet(guide.concentration_k).log_prob(pi_bk) - prior.log_prob(pi_bk)).sum()
    return kl - log_likelihood_b.sum()


def evaluated(guide: PointLike, loss: Tensor) -> list[Tensor]:
    gradients = torch.autograd.grad(loss, list(guide.parameters()))
    return [loss.detach(), *gradients]


@pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=str)
@pytest.mark.parametrize("analytic", [True, False])
def test_elbo_and_gradients_are_the_closed_form(x_bfmt: Tensor, likelihood: Likelihood, analytic: bool) -> None:
    model, guide = make_model(likelihood), PointLike()
    elbo = TraceMeanField_ELBO() if analytic else Trace_ELBO()
    torch.manual_seed(3)
    found = evaluated(guide, elbo.differentiable_loss(model, guide, x_bfmt, IMAGE_BCIJ))
    torch.manual_seed(3)
    expected = evaluated(guide, closed_form_loss(guide, x_bfmt, likelihood, analytic))
    for one, other in zip(found, expected, strict=True):
        assert (one - other).abs().max() <= 1e-9 * other.abs().max()


def test_marginal_elbo_is_that_of_explicit_masks(x_bfmt: Tensor) -> None:
    guide = PointLike()
    explicit = ExplicitMaskCGMM(STEERING_FDM, K, SparseDirichlet(ALPHA), diffuse=ROOM_DIFFUSE, room=ROOM)
    pairs = ((Trace_ELBO(), make_model(ProfiledGaussian())), (TraceEnum_ELBO(max_plate_nesting=3), explicit))
    losses = []
    for elbo, model in pairs:
        torch.manual_seed(3)
        losses.append(evaluated(guide, elbo.differentiable_loss(model, guide, x_bfmt, IMAGE_BCIJ)))
    for one, other in zip(*losses, strict=True):
        assert (one - other).abs().max() <= 1e-9 * other.abs().max()


@pytest.mark.parametrize("dtype", [torch.complex64, torch.complex128], ids=str)
@pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=str)
def test_posterior_never_falls(x_bfmt: Tensor, likelihood: Likelihood, dtype: torch.dtype) -> None:
    model, x_bfmt = make_model(likelihood, dtype), x_bfmt.to(dtype)
    mu_bkd, _ = UninformedInitializer(K, GRID).log_weights(IMAGE_BCIJ)
    mu_bkd = mu_bkd.to(x_bfmt.real.dtype)
    map_em = map_em_of(model, x_bfmt, mu_bkd)
    log_w_bkj, pi_bk = with_diffuse_start(mu_bkd, C, 0.08), mu_bkd.new_full((B, K), 1 / K)
    objectives = []
    for _ in range(40):
        state = map_em.step(log_w_bkj, pi_bk)
        objectives.append(state.objective_b)
        log_w_bkj, pi_bk = state.log_w_bkd, state.pi_bk
    rises, rounding = torch.stack(objectives).diff(dim=0), 1e-9 if dtype == torch.complex128 else 1e-5
    assert rises.min() > -rounding * objectives[0].abs().max()
    assert rises.sum(0).min() > 1.0


@pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=str)
def test_objective_is_the_model_s_joint_density(x_bfmt: Tensor, likelihood: Likelihood) -> None:
    """Differences between two points of MAP-EM's objective are those of the traced model."""
    model = make_model(likelihood)
    mu_bkd = torch.randn(B, K, D, dtype=torch.float64)
    map_em, joint, objective = map_em_of(model, x_bfmt, mu_bkd), [], []
    for seed in (0, 1):
        torch.manual_seed(seed)
        log_w_bkj = torch.randn(B, K, D + C, dtype=torch.float64)
        pi_bk = torch.rand(B, K, dtype=torch.float64).softmax(-1)
        log_w_bkj = map_em.step(log_w_bkj, pi_bk).log_w_bkd
        objective.append(map_em.step(log_w_bkj, pi_bk).objective_b)
        w_bkd, e_bkc = log_w_bkj.exp().split([D, C], dim=-1)
        at_point = {"direction_weights": w_bkd, "mixing_levels": pi_bk, "diffuse_weights": e_bkc}
        trace = pyro.poutine.trace(pyro.poutine.condition(model, at_point)).get_trace(x_bfmt, IMAGE_BCIJ)
        # MAP-EM's densities are those of log w, log e and log pi.
        joint.append(trace.log_prob_sum() + log_w_bkj.sum() + pi_bk.log().sum())
    torch.testing.assert_close(objective[1].sum() - objective[0].sum(), joint[1] - joint[0], rtol=1e-8, atol=1e-6)


def test_refined_guide_has_the_site_and_finds_the_talker(x_bfmt: Tensor) -> None:
    model = make_model(PrecedenceGaussian())
    guide = RefinedGuide(UninformedInitializer(K, GRID).double(), model, RefinementConfig(rounds=30))
    fitted = guide.fitted_to(x_bfmt, IMAGE_BCIJ)
    assert isinstance(fitted, FixedGuide)
    known = fitted.parameters_of(x_bfmt, IMAGE_BCIJ)
    assert known.diffuse_mu_bkc is not None and known.diffuse_mu_bkc.shape == (B, K, C)
    loudest_b = known.concentration_bk.argmax(-1)
    assert (known.mu_bkd[torch.arange(B), loudest_b].argmax(-1) == 5).all()
    assert math.isfinite(Trace_ELBO().loss(model, fitted, x_bfmt, IMAGE_BCIJ))


def test_diffuse_start_has_its_share() -> None:
    log_w_bkd = torch.randn(B, K, D)
    share_bkj = with_diffuse_start(log_w_bkd, C, 0.08).softmax(-1)
    torch.testing.assert_close(share_bkj[..., D:].sum(-1), torch.full((B, K), 0.08))
    assert with_diffuse_start(log_w_bkd, 0, 0.08) is log_w_bkd


def test_all_templates_have_trace_m_and_are_positive() -> None:
    trace_jf = ROOM.template_jfmm.diagonal(dim1=-2, dim2=-1).real.sum(-1)
    torch.testing.assert_close(trace_jf, torch.full_like(trace_jf, ARRAY.num_microphones))
    assert torch.linalg.eigvalsh(ROOM.template_jfmm).min() > -1e-9


def test_isotropic_field_of_free_field_is_the_sinc() -> None:
    distance_mm = np.linalg.norm(ARRAY.positions[:, None] - ARRAY.positions, axis=-1)
    expected_fmm = np.sinc(2 * FREQUENCIES[:, None, None] * distance_mm / ARRAY.speed_of_sound)
    found_fmm = IsotropicField(4000)(ARRAY, FREQUENCIES)
    torch.testing.assert_close(found_fmm.real, torch.from_numpy(expected_fmm), atol=5e-3, rtol=0)
    assert found_fmm.imag.abs().max() < 5e-3


def test_without_elevation_shares_templates_are_the_paper_s() -> None:
    flat_dfmm = elevated_templates(ARRAY, GRID, FREQUENCIES, ((0.0, 1.0),))
    torch.testing.assert_close(flat_dfmm, SpatialCGMM(STEERING_FDM).template_dfmm)


def test_components_are_free_and_templates_of_another_grid_are_refused() -> None:
    room = Room.of_array(ARRAY, GRID, FREQUENCIES, components=(SensorNoise(),))
    assert SpatialCGMM(STEERING_FDM, K, room=room).template_dfmm.shape[0] == D + 1
    with pytest.raises(InputError, match="templates"):
        SpatialCGMM(STEERING_FDM[:, :-1], K, room=room)
    with pytest.raises(InputError, match="give at least one"):
        Room.of_array(ARRAY, GRID, FREQUENCIES, components=())

"""Guides fitted to single scenes: they raise the ELBO they start on, under any model, and touch nothing around them."""

import numpy as np
import pyro
import pytest
import torch
from attrs import evolve
from pyro import distributions as dist
from pyro.infer import Trace_ELBO
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.distributions.spatial_mixture import SpatialMixture
from avssl_pyro.errors import InputError
from avssl_pyro.guides.gaussian_families import GaussianFamily, LowRank, MeanField
from avssl_pyro.guides.initializers import UninformedInitializer
from avssl_pyro.guides.per_clip import PerClipConfig, PerClipGuide, dirichlet_of_moments
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.models.spatial_cgmm import SpatialCGMM

B, D, K, T = 2, 12, 3, 20
FREQUENCIES = np.linspace(300.0, 3000.0, 8)
STEERING_FDM = FreeField(PRESETS["circle4"])(DirectionGrid(D), FREQUENCIES).to(torch.complex64)
QUICK = PerClipConfig(steps=40)
FAMILIES = pytest.mark.parametrize("family", [MeanField(), LowRank(rank=3)], ids=["mean-field", "low-rank"])


@pytest.fixture
def model() -> SpatialCGMM:
    return SpatialCGMM(STEERING_FDM, num_sources=K)


@pytest.fixture
def start() -> RefinedGuide:
    return RefinedGuide(
        UninformedInitializer(K, DirectionGrid(D)), SpatialCGMM(STEERING_FDM, K), RefinementConfig(softening=1.0)
    )


@pytest.fixture
def data() -> tuple[Tensor, Tensor]:
    """Two talkers who take turns in time and frequency, in noise."""
    torch.manual_seed(1)
    active = (torch.rand(B, len(FREQUENCIES), 1, T) < 0.5).float()
    signal = torch.randn(2, B, len(FREQUENCIES), 1, T, dtype=torch.complex64)
    first, second = (STEERING_FDM[:, d, :, None] for d in (2, 8))
    noise = 0.3 * torch.randn(B, len(FREQUENCIES), 4, T, dtype=torch.complex64)
    return first * active * signal[0] + second * (1 - active) * signal[1] + noise, torch.zeros(B, 3, 4, 8)


def mean_elbo(model: SpatialCGMM, guide: torch.nn.Module, data: tuple[Tensor, Tensor]) -> float:
    torch.manual_seed(0)
    estimator = Trace_ELBO(num_particles=200, vectorize_particles=True, max_plate_nesting=1)
    with torch.no_grad():
        return -estimator.loss(model, guide, *data)


@FAMILIES
def test_a_fit_raises_the_elbo_of_its_start(
    family: GaussianFamily, model: SpatialCGMM, start: RefinedGuide, data: tuple[Tensor, Tensor]
) -> None:
    start.config = evolve(start.config, rounds=5)
    fitted = PerClipGuide(start, model, family).fitted_to(*data)
    assert mean_elbo(model, fitted, data) > mean_elbo(model, start, data) + 20


@FAMILIES
def test_what_has_arrived_is_not_made_worse(
    family: GaussianFamily, model: SpatialCGMM, start: RefinedGuide, data: tuple[Tensor, Tensor]
) -> None:
    fitted = PerClipGuide(start, model, family).fitted_to(*data)
    assert mean_elbo(model, fitted, data) > mean_elbo(model, start, data)


@FAMILIES
def test_the_elbo_estimated_by_pyro_is_that_of_the_guide_itself(
    family: GaussianFamily, model: SpatialCGMM, start: RefinedGuide, data: tuple[Tensor, Tensor]
) -> None:
    """One draw of the guide, whose fit must leave no trace in the estimator's."""
    trace = pyro.poutine.trace(PerClipGuide(start, model, family, QUICK)).get_trace(*data)
    assert trace.stochastic_nodes == ["clip", "direction_weights", "mixing_levels"]
    assert not trace.observation_nodes
    assert trace.nodes["direction_weights"]["value"].shape == (B, K, D)
    level_bk = trace.nodes["mixing_levels"]["value"]
    assert level_bk.shape == (B, K)
    torch.testing.assert_close(level_bk.sum(-1), torch.ones(B))
    trace.compute_log_prob()
    assert trace.nodes["mixing_levels"]["log_prob"].shape == (B,)


@FAMILIES
def test_a_clip_does_not_depend_on_its_batch_nor_a_fit_on_the_state_around_it(
    family: GaussianFamily, model: SpatialCGMM, start: RefinedGuide, data: tuple[Tensor, Tensor]
) -> None:
    guide = PerClipGuide(start, model, family, QUICK)
    together = guide.parameters_of(*data)
    torch.manual_seed(7)
    expected = torch.rand(())
    torch.manual_seed(7)
    with torch.no_grad():
        alone = guide.parameters_of(data[0][1:], data[1][1:])
    assert torch.rand(()) == expected
    assert not pyro.get_param_store()
    torch.testing.assert_close(alone.mu_bkd[0], together.mu_bkd[1], rtol=1e-2, atol=1e-2)
    torch.testing.assert_close(alone.sigma_bkd[0], together.sigma_bkd[1], rtol=1e-2, atol=1e-2)


class LevelsFirst(SpatialCGMM):
    """The same model, its sites in the other order."""

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:  # noqa: ARG002
        with pyro.plate("clip", len(x_bfmt), dim=-1):
            pi_bk = pyro.sample("mixing_levels", self.level_prior(K, self.template_pairs))
            w_bkd = pyro.sample("direction_weights", self.direction_prior(K, D, self.template_pairs))
            pyro.sample("spectrogram", SpatialMixture(self.template_dfmm, w_bkd, pi_bk, num_frames=T), obs=x_bfmt)


@FAMILIES
def test_a_model_may_draw_its_sites_in_any_order(
    family: GaussianFamily, model: SpatialCGMM, start: RefinedGuide, data: tuple[Tensor, Tensor]
) -> None:
    fitted = PerClipGuide(start, LevelsFirst(STEERING_FDM, K), family).fitted_to(*data)
    assert mean_elbo(model, fitted, data) > mean_elbo(model, start, data)


def test_a_model_with_other_latents_is_refused(start: RefinedGuide, data: tuple[Tensor, Tensor]) -> None:
    def more(x_bfmt: Tensor, image_bcij: Tensor) -> None:
        pyro.sample("temperature", dist.Normal(0.0, 1.0))
        SpatialCGMM(STEERING_FDM, K)(x_bfmt, image_bcij)

    with pytest.raises(InputError, match="temperature"):
        PerClipGuide(start, more).fitted_to(*data)


def test_settings_out_of_range_are_refused() -> None:
    for wrong in ({"steps": 0}, {"learning_rate": 0.0}):
        with pytest.raises(InputError, match="PerClipConfig"):
            PerClipConfig(**wrong)
    with pytest.raises(InputError, match="rank is 0"):
        LowRank(rank=0)


def test_matching_moments_returns_the_dirichlet_the_levels_were_drawn_from() -> None:
    torch.manual_seed(0)
    concentration_bk = torch.tensor([[1.0, 5.0, 20.0], [40.0, 40.0, 0.5]])
    found_bk = dirichlet_of_moments(dist.Dirichlet(concentration_bk).sample((20000,)))
    torch.testing.assert_close(found_bk, concentration_bk, rtol=0.05, atol=0.02)


def test_a_start_of_emptied_classes_stays_finite(model: SpatialCGMM, data: tuple[Tensor, Tensor]) -> None:
    class Emptied(torch.nn.Module):
        def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> object:
            parameters = RefinedGuide(
                UninformedInitializer(K, DirectionGrid(D)), SpatialCGMM(STEERING_FDM, K), RefinementConfig()
            ).parameters_of(x_bfmt, image_bcij)
            return parameters._replace(concentration_bk=torch.tensor([[1e-3, 1e7, 1e-3]] * B))

    for value in PerClipGuide(Emptied(), model, MeanField(), QUICK).parameters_of(*data)[:4]:
        assert torch.isfinite(value).all()

"""Spreads by information: nearer to what a fit finds than those of the ascent, at no cost to the means."""

import numpy as np
import pytest
import torch
from pyro.infer import Trace_ELBO
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.distributions.spatial_mixture import SpatialMixture
from avssl_pyro.errors import InputError
from avssl_pyro.guides.blind_start import BlindStart
from avssl_pyro.guides.informed_spread import InformedSpreadGuide
from avssl_pyro.guides.per_scene import PerSceneGuide
from avssl_pyro.guides.refined import RefinedGuide, RefinementConfig
from avssl_pyro.models.likelihoods import InverseGammaPsd
from avssl_pyro.models.priors import SymmetricDirichlet
from avssl_pyro.models.spatial_cgmm import SpatialCGMM

B, D, K, F, T = 2, 12, 3, 8, 25
STEERING_FDM = FreeField(PRESETS["circle4"])(DirectionGrid(D), np.linspace(300.0, 3000.0, F)).to(torch.complex64)
MODEL = SpatialCGMM(STEERING_FDM, K, SymmetricDirichlet(1.0))
REFINED = RefinedGuide(BlindStart(K, DirectionGrid(D)), MODEL, RefinementConfig(softening=1.0))
INFORMED = InformedSpreadGuide(REFINED)


@pytest.fixture(scope="module")
def data() -> tuple[Tensor, Tensor]:
    torch.manual_seed(2)
    w_bkd = (torch.randn(B, K, D) * 1.5).exp()
    pi_bk = torch.tensor([[0.5, 0.3, 0.2]] * B)
    psd = torch.ones(B, F, K, T)
    x_bfmt = SpatialMixture(MODEL.template_dfmm, w_bkd, pi_bk, num_frames=T, psd_bfkt=psd).sample()
    return x_bfmt, torch.zeros(B, 3, 1, 1)


def elbo(guide: torch.nn.Module, data: tuple[Tensor, Tensor]) -> float:
    torch.manual_seed(0)
    estimator = Trace_ELBO(num_particles=200, vectorize_particles=True, max_plate_nesting=1)
    with torch.no_grad():
        return -estimator.loss(MODEL, guide, *data)


def test_the_elbo_rises_and_the_means_stay(data: tuple[Tensor, Tensor]) -> None:
    assert elbo(INFORMED, data) > elbo(REFINED, data) + 20
    refined, informed = REFINED.parameters_of(*data), INFORMED.parameters_of(*data)
    assert torch.equal(informed.mu_bkd, refined.mu_bkd)
    assert (informed.concentration_bk.sum(-1) < refined.concentration_bk.sum(-1)).all()


def test_the_spread_is_near_that_of_a_fit(data: tuple[Tensor, Tensor]) -> None:
    fitted_bkd = PerSceneGuide(REFINED, MODEL).parameters_of(*data).sigma_bkd
    errors = [
        (guide.parameters_of(*data).sigma_bkd.log() - fitted_bkd.log()).square().mean().sqrt().item()
        for guide in (INFORMED, REFINED)
    ]
    assert errors[0] < 0.35
    assert errors[1] > 2.5 * errors[0]


def test_a_likelihood_whose_information_is_not_known_is_refused() -> None:
    model = SpatialCGMM(STEERING_FDM, K, likelihood=InverseGammaPsd())
    with pytest.raises(InputError, match="InverseGammaPsd"):
        InformedSpreadGuide(RefinedGuide(BlindStart(K, DirectionGrid(D)), model))

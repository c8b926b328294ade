from dataclasses import dataclass
from typing import Any

import numpy as np
import pyro
import pyro.distributions as dist
import pytest
import torch
from pyro.distributions import TorchDistribution
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.distributions.spatial_mixture import SpatialMixture
from avssl_pyro.errors import InputError
from avssl_pyro.models.explicit_masks import ExplicitMaskCGMM
from avssl_pyro.models.priors import LogNormalWeights, SparseDirichlet
from avssl_pyro.models.spatial_cgmm import SpatialCGMM

B, F, D, M, K, T = 2, 3, 8, 2, 3, 4
FREQUENCIES = np.array([500.0, 1000.0, 2000.0])


def steering(dtype: torch.dtype = torch.complex64) -> Tensor:
    return FreeField(PRESETS["circle2"])(DirectionGrid(D), FREQUENCIES).to(dtype)


def data(dtype: torch.dtype = torch.complex64) -> tuple[Tensor, Tensor]:
    torch.manual_seed(0)
    return torch.randn(B, F, M, T, dtype=dtype), torch.rand(B, 3, 16, 32)


def test_sites_of_the_model_are_the_public_ones() -> None:
    trace = pyro.poutine.trace(SpatialCGMM(steering(), num_sources=K)).get_trace(*data())
    assert trace.stochastic_nodes == ["clip", "direction_weights", "mixing_levels"]
    assert trace.observation_nodes == ["spectrogram"]
    assert trace.nodes["direction_weights"]["value"].shape == (B, K, D)
    assert trace.nodes["mixing_levels"]["value"].shape == (B, K)
    mixture = trace.nodes["spectrogram"]["fn"]
    assert isinstance(mixture, SpatialMixture)
    assert mixture.batch_shape == (B,)
    trace.compute_log_prob()
    for site in ("direction_weights", "mixing_levels", "spectrogram"):
        assert trace.nodes[site]["log_prob"].shape == (B,)
        assert trace.nodes[site]["log_prob"].isfinite().all()


def test_default_priors_are_those_of_the_paper() -> None:
    trace = pyro.poutine.trace(SpatialCGMM(steering(), num_sources=K)).get_trace(*data())
    levels = trace.nodes["mixing_levels"]["fn"]
    weights = trace.nodes["direction_weights"]["fn"].base_dist
    assert levels.concentration.unique().tolist() == pytest.approx([0.01])
    assert (weights.loc == 0).all()
    assert (weights.scale == 1).all()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_priors_follow_dtype_and_shape_of_the_model(dtype: torch.dtype) -> None:
    like = torch.zeros((), dtype=dtype)
    levels = SparseDirichlet(0.5)(K, like)
    weights = LogNormalWeights(2.0)(K, D, like)
    assert (levels.batch_shape, levels.event_shape, levels.sample().dtype) == ((), (K,), dtype)
    assert (weights.batch_shape, weights.event_shape, weights.sample().dtype) == ((), (K, D), dtype)
    assert weights.base_dist.scale.unique().tolist() == [2.0]


@dataclass(frozen=True)
class GammaWeights:
    """A prior the package does not know."""

    shape: float

    def __call__(self, num_sources: int, num_directions: int, like: Tensor) -> TorchDistribution:
        return dist.Gamma(like.new_full((num_sources, num_directions), self.shape), like.new_ones(())).to_event(2)


@pytest.mark.parametrize("model_class", [SpatialCGMM, ExplicitMaskCGMM])
def test_priors_of_ones_own_need_no_change_in_the_package(model_class: type[SpatialCGMM | ExplicitMaskCGMM]) -> None:
    model = model_class(
        steering(),
        num_sources=K,
        level_prior=lambda num_sources, like: dist.Dirichlet(like.new_full((num_sources,), 7.0)),
        direction_prior=GammaWeights(3.0),
    )
    with pyro.poutine.enum(first_available_dim=-4):
        trace = pyro.poutine.trace(model).get_trace(*data())
    assert isinstance(trace.nodes["direction_weights"]["fn"].base_dist, dist.Gamma)
    assert (trace.nodes["mixing_levels"]["fn"].concentration == 7).all()
    trace.compute_log_prob()
    assert trace.nodes["direction_weights"]["log_prob"].shape == (B,)


def test_model_carries_no_weights_and_casts_as_a_whole() -> None:
    model = SpatialCGMM(steering(torch.complex128), num_sources=K)
    assert not list(model.parameters())
    assert not model.state_dict()
    assert model.template_dfmm.shape == (D, F, M, M)
    assert model.template_dfmm.dtype == torch.complex128
    single = model.to(torch.float32)
    assert single.template_dfmm.dtype == torch.complex64
    trace = pyro.poutine.trace(single).get_trace(*data())
    assert trace.nodes["direction_weights"]["value"].dtype == torch.float32


@pytest.mark.parametrize("seed", range(3))
def test_marginal_and_explicit_masks_agree_at_given_latents(seed: int) -> None:
    """Sums the explicit model's joint over masks by hand; TraceEnum_ELBO does the same elsewhere."""
    x_bfmt, image_bcij = data(torch.complex128)
    torch.manual_seed(seed)
    latents = {
        "direction_weights": torch.rand(B, K, D, dtype=torch.float64) + 0.01,
        "mixing_levels": torch.rand(B, K, dtype=torch.float64).softmax(-1),
    }
    log_prob = []
    for model in (SpatialCGMM(steering(torch.complex128), K), ExplicitMaskCGMM(steering(torch.complex128), K)):
        enumerated = pyro.poutine.enum(pyro.condition(model, latents), first_available_dim=-4)
        trace = pyro.poutine.trace(enumerated).get_trace(x_bfmt, image_bcij)
        trace.compute_log_prob()
        if "mask" in trace.nodes:
            joint_kftb = trace.nodes["mask"]["log_prob"] + trace.nodes["spectrogram"]["log_prob"]
            assert joint_kftb.shape == (K, F, T, B)
            log_prob.append(joint_kftb.logsumexp(0).sum((0, 1)))
        else:
            log_prob.append(trace.nodes["spectrogram"]["log_prob"])
    torch.testing.assert_close(log_prob[0], log_prob[1], rtol=1e-10, atol=0)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"num_sources": 0}, "num_sources is 0; it must be at least 1"),
        ({"diffuse": 0.0}, "diffuse is 0.0; it must be at least 0.001"),
        ({"bin_weight": -1.0}, "bin_weight is -1.0; it must be positive"),
        (
            {"direction_prior": lambda k, d, like: dist.LogNormal(like.new_zeros(k, d), 1.0)},
            r"direction_prior returned a distribution of batch shape \(4, 8\) and event shape \(\); they must be \(\)",
        ),
        (
            {"level_prior": lambda k, like: dist.Dirichlet(like.new_ones(k - 1))},
            r"level_prior returned .* event shape \(3,\); they must be \(\) and \(4,\)",
        ),
    ],
)
def test_models_that_cannot_be_are_refused(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        SpatialCGMM(steering(), **changes)

import copy
from collections.abc import Callable

import numpy as np
import pyro
import pytest
import torch
from pyro.infer import SVI, Trace_ELBO, TraceMeanField_ELBO
from torch import Tensor, nn

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.guides.amortized import LEAST_CONCENTRATION, LOG_WEIGHT_LIMIT, AmortizedGuide, UniformLevelGuide
from avssl_pyro.models.spatial_cgmm import SpatialCGMM
from avssl_pyro.networks.audio import AudioNet
from avssl_pyro.networks.visual import VisualNet

B, D, K, T = 2, 8, 3, 5
FREQUENCIES = np.linspace(0.0, 8000.0, 17)
STEERING_FDM = FreeField(PRESETS["circle4"])(DirectionGrid(D), FREQUENCIES).to(torch.complex64)

Guide = AmortizedGuide | UniformLevelGuide


def visual() -> VisualNet:
    return VisualNet(K, D, channels=(4, 4))


def amortized() -> AmortizedGuide:
    return AmortizedGuide(visual(), AudioNet(STEERING_FDM, channels=4))


def uniform() -> UniformLevelGuide:
    return UniformLevelGuide(visual())


GUIDES = pytest.mark.parametrize("make_guide", [amortized, uniform])


def model() -> SpatialCGMM:
    return SpatialCGMM(STEERING_FDM, num_sources=K)


@pytest.fixture
def data() -> tuple[Tensor, Tensor]:
    """Clips in which one direction speaks, with pictures of it."""
    torch.manual_seed(0)
    signal = torch.randn(B, len(FREQUENCIES), 1, T, dtype=torch.complex64)
    x_bfmt = STEERING_FDM[:, 2, :, None] * signal + 0.05 * torch.randn(B, len(FREQUENCIES), 4, T)
    image_bcij = 0.1 * torch.rand(B, 3, 16, 32)
    image_bcij[..., 8:12] = 1.0
    return x_bfmt, image_bcij


@GUIDES
def test_sites_of_the_guide_are_the_public_ones(make_guide: Callable[[], Guide], data: tuple[Tensor, Tensor]) -> None:
    trace = pyro.poutine.trace(make_guide()).get_trace(*data)
    assert trace.stochastic_nodes == ["clip", "direction_weights", "mixing_levels"]
    assert not trace.observation_nodes
    assert trace.nodes["direction_weights"]["value"].shape == (B, K, D)
    assert trace.nodes["mixing_levels"]["value"].shape == (B, K)
    trace.compute_log_prob()
    for site in ("direction_weights", "mixing_levels"):
        assert trace.nodes[site]["log_prob"].shape == (B,)


@GUIDES
@pytest.mark.parametrize("local", [False, True], ids=["global-params", "local-params"])
def test_trace_elbo_falls_under_a_torch_optimizer(
    make_guide: Callable[[], Guide], data: tuple[Tensor, Tensor], local: bool
) -> None:
    with pyro.settings.context(module_local_params=local):
        torch.manual_seed(1)
        loss_module = Trace_ELBO()(model(), make_guide())
        optimizer = torch.optim.Adam(loss_module.parameters(), lr=0.03)
        losses = []
        for _ in range(25):
            loss = loss_module(*data)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses.append(loss.item())
        assert sum(losses[-5:]) < sum(losses[:5])
        if local:
            assert not pyro.get_param_store()


@GUIDES
def test_svi_step_lowers_the_loss_with_pyros_default_settings(
    make_guide: Callable[[], Guide], data: tuple[Tensor, Tensor]
) -> None:
    assert not pyro.settings.get("module_local_params")
    torch.manual_seed(1)
    guide = make_guide()
    before = copy.deepcopy(guide.state_dict())
    svi = SVI(model(), guide, pyro.optim.Adam({"lr": 0.03}), Trace_ELBO())
    losses = [svi.step(*data) for _ in range(25)]
    assert sum(losses[-5:]) < sum(losses[:5])
    for name, parameter in guide.named_parameters():
        # A shift of all logits changes no softmax, so the last bias of AudioNet does not move.
        assert name == "audio.affine.bias" or not torch.equal(parameter, before[name]), name


@GUIDES
def test_vectorized_particles_estimate_the_same_elbo(
    make_guide: Callable[[], Guide], data: tuple[Tensor, Tensor]
) -> None:
    torch.manual_seed(1)
    generative, guide = model(), make_guide().eval()

    def estimate(vectorize: bool, repeats: int) -> Tensor:
        elbo = Trace_ELBO(num_particles=3, vectorize_particles=vectorize, max_plate_nesting=1)(generative, guide)
        with torch.no_grad():
            return torch.stack([elbo(*data).detach() for _ in range(repeats)])

    vectorized, looped = estimate(True, 60), estimate(False, 20)
    assert vectorized.isfinite().all()
    standard_error = (vectorized.var() / 60 + looped.var() / 20).sqrt()
    assert (vectorized.mean() - looped.mean()).abs() < 5 * standard_error


@GUIDES
def test_vectorized_particles_differentiate(make_guide: Callable[[], Guide], data: tuple[Tensor, Tensor]) -> None:
    guide = make_guide()
    elbo = TraceMeanField_ELBO(num_particles=3, vectorize_particles=True, max_plate_nesting=1)
    elbo(model(), guide)(*data).backward()
    assert all(parameter.grad is not None and parameter.grad.isfinite().all() for parameter in guide.parameters())


@GUIDES
def test_deep_copies_and_loaded_states_are_equal_but_apart(
    make_guide: Callable[[], Guide], data: tuple[Tensor, Tensor]
) -> None:
    with pyro.settings.context(module_local_params=True):
        torch.manual_seed(1)
        guide, other = make_guide().eval(), make_guide().eval()
        Trace_ELBO()(model(), guide)(*data)
        twin = copy.deepcopy(guide)
        other.load_state_dict(guide.state_dict())
        losses = []
        for each in (guide, twin, other):
            torch.manual_seed(2)
            losses.append(Trace_ELBO()(model(), each)(*data).item())
        assert losses[0] == losses[1] == losses[2]
        with torch.no_grad():
            twin.log_sigma_k.add_(1.0)
        assert not torch.equal(twin.log_sigma_k, guide.log_sigma_k)
        torch.manual_seed(2)
        assert Trace_ELBO()(model(), guide)(*data).item() == losses[0]


@GUIDES
def test_permuted_source_classes_permute_the_posterior(
    make_guide: Callable[[], Guide], data: tuple[Tensor, Tensor]
) -> None:
    torch.manual_seed(1)
    guide = make_guide().eval()
    order = torch.tensor([2, 0, 1])
    twin = copy.deepcopy(guide)
    head = twin.visual.head[-1]
    with torch.no_grad():
        head.weight.copy_(head.weight[order].clone())
        head.bias.copy_(head.bias[order].clone())
        found, permuted = guide.parameters_of(*data), twin.parameters_of(*data)
    torch.testing.assert_close(permuted.mu_bkd, found.mu_bkd[:, order])
    torch.testing.assert_close(permuted.activation_bkij, found.activation_bkij[:, order])
    torch.testing.assert_close(permuted.concentration_bk, found.concentration_bk[:, order])


def test_initial_spread_and_concentration(data: tuple[Tensor, Tensor]) -> None:
    guide = AmortizedGuide(visual(), AudioNet(STEERING_FDM, channels=4), initial_sigma=0.2, initial_beta=50.0)
    trace = pyro.poutine.trace(guide).get_trace(*data)
    assert trace.nodes["direction_weights"]["fn"].base_dist.scale.unique().tolist() == pytest.approx([0.2])
    total_b = trace.nodes["mixing_levels"]["fn"].concentration.sum(-1)
    assert total_b.tolist() == pytest.approx([50.0] * B, rel=1e-4)


def test_localization_uses_the_softmax_of_the_log_weights(data: tuple[Tensor, Tensor]) -> None:
    """Eq. (1): levels are estimated at w = softmax(mu), which no draw takes part in."""
    x_bfmt, image_bcij = data
    guide = amortized().eval()
    with torch.no_grad():
        parameters = guide.parameters_of(*data)
        again = guide.parameters_of(*data)
        mu_bkd, _ = guide.visual(image_bcij)
        level_bk = guide.audio(x_bfmt, mu_bkd.softmax(-1))
    assert torch.equal(parameters.concentration_bk, again.concentration_bk)
    torch.testing.assert_close(parameters.mu_bkd, mu_bkd)
    torch.testing.assert_close(parameters.concentration_bk, guide.log_beta.exp().detach() * level_bk)


class _Extreme(VisualNet):
    """A visual network that has run away."""

    def forward(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]:
        mu_bkd, activation_bkij = super().forward(image_bcij)
        return 1e6 * mu_bkd, activation_bkij


def test_runaway_networks_leave_the_elbo_and_its_gradients_finite(data: tuple[Tensor, Tensor]) -> None:
    audio = AudioNet(STEERING_FDM, channels=4)
    guide = AmortizedGuide(_Extreme(K, D, channels=(4, 4)), audio, initial_sigma=1.0, initial_beta=1e-6)
    nn.init.constant_(audio.affine.weight, 1e4)
    trace = pyro.poutine.trace(guide).get_trace(*data)
    assert trace.nodes["direction_weights"]["fn"].base_dist.loc.abs().max() <= LOG_WEIGHT_LIMIT
    assert trace.nodes["mixing_levels"]["fn"].concentration.min() >= LEAST_CONCENTRATION * (1 - 1e-6)
    for seed in range(10):
        torch.manual_seed(seed)
        for elbo in (Trace_ELBO(), TraceMeanField_ELBO()):
            guide.zero_grad()
            loss = elbo(model(), guide)(*data)
            loss.backward()
            assert loss.isfinite()
            assert all(p.grad is None or p.grad.isfinite().all() for p in guide.parameters())


def test_without_the_audio_network_every_level_is_equal(data: tuple[Tensor, Tensor]) -> None:
    guide = uniform().eval()
    levels_bk = pyro.poutine.trace(guide).get_trace(*data).nodes["mixing_levels"]["value"]
    assert levels_bk.tolist() == [[pytest.approx(1 / K)] * K] * B
    concentration_bk = guide.parameters_of(*data).concentration_bk
    assert (concentration_bk == concentration_bk[0, 0]).all()
    # So certain that the posterior spread of a level vanishes.
    assert (1 / concentration_bk).max() < 1e-6


@pytest.mark.parametrize(
    "make_guide",
    [
        lambda: AmortizedGuide(visual(), AudioNet(STEERING_FDM, channels=4), diffuse_class=True),
        lambda: UniformLevelGuide(visual(), diffuse_class=True),
    ],
)
def test_the_diffuse_class_comes_last_and_looks_everywhere_alike(
    make_guide: Callable[[], Guide], data: tuple[Tensor, Tensor]
) -> None:
    guide = make_guide().eval()
    parameters = guide.parameters_of(*data)
    assert parameters.mu_bkd.shape == (B, K + 1, D)
    assert (parameters.mu_bkd[:, -1] == 0).all()
    torch.testing.assert_close(parameters.mu_bkd[:, :-1], guide.visual(data[1])[0])
    assert parameters.activation_bkij.shape[1] == K + 1
    assert parameters.concentration_bk.shape == (B, K + 1)
    assert Trace_ELBO()(SpatialCGMM(STEERING_FDM, num_sources=K + 1), guide)(*data).isfinite()

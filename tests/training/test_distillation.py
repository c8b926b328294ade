"""Refined posteriors as targets: they find the talkers without labels, and the guide is drawn to them."""

import numpy as np
import pyro
import pytest
import torch
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.errors import InputError
from avssl_pyro.guides.amortized import AmortizedGuide
from avssl_pyro.guides.base import GuideParameters
from avssl_pyro.models.room import Room
from avssl_pyro.models.spatial_cgmm import SpatialCGMM
from avssl_pyro.networks.audio import AudioNet
from avssl_pyro.networks.visual import VisualNet
from avssl_pyro.training.config import DistillationConfig
from avssl_pyro.training.distillation import DistillationLoss, log_outcomes, split_entropy
from avssl_pyro.training.elbo_terms import TraceMeanFieldELBOWithTerms

B, D, K, T = 2, 24, 5, 40
STEERING_FDM = FreeField(PRESETS["circle4"])(DirectionGrid(D), np.linspace(250.0, 4000.0, 16)).to(torch.complex64)
ROOM = Room.of_array(PRESETS["circle4"], DirectionGrid(D), np.linspace(250.0, 4000.0, 16))
TRUE_DIRECTIONS = (3, 14)


def taught(
    config: DistillationConfig, particles: int = 1, bin_weight: float = 1.0, room: Room | None = None
) -> tuple[DistillationLoss, AmortizedGuide]:
    torch.manual_seed(0)
    model = SpatialCGMM(STEERING_FDM, num_sources=K, bin_weight=bin_weight, room=room)
    visual = VisualNet(K - 1, D, channels=(4, 4), anchor_gain=2.0)
    audio = AudioNet(STEERING_FDM, channels=4, num_diffuse=0 if room is None else room.num_components)
    guide = AmortizedGuide(visual, audio, diffuse_class=True)
    estimator = TraceMeanFieldELBOWithTerms(particles, max_plate_nesting=1, vectorize_particles=particles > 1)
    with pyro.settings.context(module_local_params=True):
        return DistillationLoss(
            estimator(model, guide), estimator, model, guide, config, diffuse_class=True
        ).eval(), guide


@pytest.fixture
def data() -> tuple[Tensor, Tensor]:
    torch.manual_seed(1)
    active = (torch.rand(B, 16, 1, T) < 0.5).float()
    signal = torch.randn(2, B, 16, 1, T, dtype=torch.complex64)
    first, second = (STEERING_FDM[:, d, :, None] for d in TRUE_DIRECTIONS)
    noise = 0.1 * torch.randn(B, 16, 4, T, dtype=torch.complex64)
    return first * active * signal[0] + second * (1 - active) * signal[1] + noise, torch.rand(B, 3, 32, 48)


@pytest.fixture(autouse=True)
def local_parameters() -> object:
    with pyro.settings.context(module_local_params=True):
        yield


@pytest.mark.parametrize("bin_weight", [1.0, 4.0])
def test_without_strength_it_is_the_elbo_per_bin(data: tuple[Tensor, Tensor], bin_weight: float) -> None:
    module, _ = taught(DistillationConfig(weight=1.0), bin_weight=bin_weight)
    torch.manual_seed(5)
    loss, cross_entropies = module(*data, 0.0)
    torch.manual_seed(5)
    torch.testing.assert_close(loss, module.loss(*data) / (B * 16 * T * bin_weight))
    assert cross_entropies.tolist() == [0, 0]


@pytest.mark.parametrize("particles", [1, 3])
def test_it_adds_the_cross_entropies_with_their_weights(data: tuple[Tensor, Tensor], particles: int) -> None:
    module, _ = taught(DistillationConfig(weight=2.0, level_weight=0.5), particles)
    values = {}
    for strength in (0.0, 0.5):
        torch.manual_seed(5)
        values[strength] = module(*data, strength)
    loss, cross_entropies = values[0.5]
    of_directions, of_levels = cross_entropies
    torch.testing.assert_close(loss, values[0.0][0] + of_directions + 0.25 * of_levels)
    assert not cross_entropies.requires_grad
    # Of distributions over 25 and 5 outcomes, of which most are never the answer.
    assert 0 < of_directions < 10
    assert 0 < of_levels < 5


def learn(module: DistillationLoss, guide: AmortizedGuide, data: tuple[Tensor, Tensor]) -> GuideParameters:
    """From the cross-entropies alone, which nobody labelled; the picture is noise, so these very clips are learnt."""
    config = module._config
    optimizer = torch.optim.Adam(guide.parameters(), lr=0.03)
    for _ in range(60):
        module(*data, 0.0)
        of_directions, of_levels = module._cross_entropies(data[0])
        optimizer.zero_grad()
        (config.weight * of_directions + config.level_weight * of_levels).backward()
        optimizer.step()
    with torch.no_grad():
        return guide.parameters_of(*data)


def test_the_guide_learns_where_the_talkers_are(data: tuple[Tensor, Tensor]) -> None:
    parameters = learn(*taught(DistillationConfig(weight=1.0)), data)
    level_bk = parameters.concentration_bk / parameters.concentration_bk.sum(-1, keepdim=True)
    sound_bd = (level_bk[:, None] @ parameters.mu_bkd.softmax(-1)).squeeze(1)
    near = [d + offset for d in TRUE_DIRECTIONS for offset in (-1, 0, 1)]
    assert (sound_bd[:, near].sum(-1) > 0.6).all()


def test_the_audio_network_learns_which_class_hears_a_talker(data: tuple[Tensor, Tensor]) -> None:
    module, guide = taught(DistillationConfig(level_weight=1.0))
    looking = [parameter.clone() for parameter in guide.visual.parameters()]
    target = module._refine(data[0], guide.log_weights(data[1])[0])
    parameters = learn(module, guide, data)
    for before, after in zip(looking, guide.visual.parameters(), strict=True):
        torch.testing.assert_close(before, after)
    level_bk = parameters.concentration_bk / parameters.concentration_bk.sum(-1, keepdim=True)
    torch.testing.assert_close(level_bk, target.pi_bk, atol=0.15, rtol=0)
    assert (target.pi_bk.amax(-1) > 0.3).all()


@pytest.mark.parametrize("num_directed", [2, 3])
def test_outcomes_are_the_mixture_over_classes(num_directed: int) -> None:
    share_bkd, pi_bk = torch.rand(B, 3, D).softmax(-1), torch.rand(B, 3).softmax(-1)
    n = num_directed
    outcome_bo = log_outcomes(share_bkd.log(), pi_bk.log(), n, D).exp()
    torch.testing.assert_close(outcome_bo[:, :D], torch.einsum("bk,bkd->bd", pi_bk[:, :n], share_bkd[:, :n]))
    torch.testing.assert_close(outcome_bo.sum(-1), torch.ones(B))
    assert outcome_bo.shape == (B, D + 3 - n)


def test_diffuse_components_have_no_direction() -> None:
    share_bkj, pi_bk = torch.rand(B, 3, D + 2).softmax(-1), torch.rand(B, 3).softmax(-1)
    outcome_bo = log_outcomes(share_bkj.log(), pi_bk.log(), 3, D).exp()
    torch.testing.assert_close(outcome_bo[:, D], torch.einsum("bk,bkc->b", pi_bk, share_bkj[..., D:]))
    torch.testing.assert_close(outcome_bo.sum(-1), torch.ones(B))


def test_a_class_is_split_at_the_least_entropy_by_its_own_shares() -> None:
    share_bkj = torch.rand(B, 3, D + 2).softmax(-1)
    own_bk, other_bk = (split_entropy(share_bkj, of.log(), D) for of in (share_bkj, share_bkj.flip(-1)))
    assert (own_bk < other_bk).all()
    # How a class spreads over the directions does not matter.
    turned_bkj = torch.cat([share_bkj[..., :D].roll(3, -1), share_bkj[..., D:]], dim=-1)
    torch.testing.assert_close(split_entropy(share_bkj, turned_bkj.log(), D), own_bk)


def test_the_audio_network_learns_how_diffuse_a_class_is(data: tuple[Tensor, Tensor]) -> None:
    module, guide = taught(DistillationConfig(level_weight=1.0), room=ROOM)
    target = module._refine(data[0], guide.log_weights(data[1])[0])
    target_bkj = target.log_w_bkd.softmax(-1)

    def error(parameters: GuideParameters) -> Tensor:
        assert parameters.diffuse_mu_bkc is not None
        found_bkj = torch.cat([parameters.mu_bkd, parameters.diffuse_mu_bkc], dim=-1).log_softmax(-1)
        own_bk, found_bk = (split_entropy(target_bkj, of, D) for of in (target_bkj.log(), found_bkj))
        return (found_bk - own_bk).sum()

    with torch.no_grad():
        before = error(guide.parameters_of(*data))
    assert error(learn(module, guide, data)) < before / 3


def test_a_direction_that_the_guide_rules_out_keeps_its_gradient() -> None:
    mu_bkd = torch.zeros(1, 2, D)
    mu_bkd[:, :, 5] = -150.0
    assert mu_bkd.softmax(-1)[..., 5].eq(0).all()
    mu_bkd.requires_grad_()
    log_outcome_bo = log_outcomes(mu_bkd.log_softmax(-1), torch.tensor([[0.5, 0.5]]).log(), 2, D)
    (-log_outcome_bo[0, 5]).backward()
    assert mu_bkd.grad is not None
    # All of the gradient of a cross-entropy, not a rest of it: both classes are drawn there alike.
    torch.testing.assert_close(mu_bkd.grad[0, :, 5], torch.tensor([-0.5, -0.5]))


def test_the_strength_rises_over_the_warmup_and_stays() -> None:
    config = DistillationConfig(weight=0.2, warmup=0.5)
    assert [config.strength_at(step, 100) for step in (0, 25, 50, 99)] == pytest.approx([0.0, 0.5, 1.0, 1.0])
    assert DistillationConfig(level_weight=0.2, warmup=0.0).strength_at(1, 100) == 1
    assert DistillationConfig().strength_at(99, 100) == 0


@pytest.mark.parametrize(
    "wrong", [{"weight": -1.0}, {"level_weight": -1.0}, {"rounds": 0}, {"smoothing_deg": 0.0}, {"warmup": 2.0}]
)
def test_impossible_settings_are_refused_in_a_sentence(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"DistillationConfig: .*{next(iter(wrong))}"):
        DistillationConfig(**wrong)  # type: ignore[arg-type]

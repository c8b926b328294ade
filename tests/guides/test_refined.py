"""The refined guide: it climbs the ELBO it starts on, clip by clip, and stays within the public sites."""

from typing import Any

import numpy as np
import pyro
import pyro.distributions as dist
import pytest
import torch
from attrs import evolve
from pyro.infer import Trace_ELBO
from torch import Tensor

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.errors import InputError
from avssl_pyro.guides.amortized import AmortizedGuide
from avssl_pyro.guides.conjugacy import map_em_of
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.models.likelihoods import FrameActivity, InverseGammaPsd, ProfiledGaussian
from avssl_pyro.models.priors import (
    CircularWeights,
    DirectionPrior,
    GammaWeights,
    HalfNormalWeights,
    LogisticNormal,
    LogNormalWeights,
    SparseDirichlet,
    SpikeAndSlabWeights,
    StickBreaking,
    SymmetricDirichlet,
)
from avssl_pyro.models.spatial_cgmm import SpatialCGMM
from avssl_pyro.networks.audio import AudioNet
from avssl_pyro.networks.visual import VisualNet

B, D, K, T = 3, 24, 3, 40
FREQUENCIES = np.linspace(250.0, 4000.0, 16)
STEERING_FDM = FreeField(PRESETS["circle4"])(DirectionGrid(D), FREQUENCIES).to(torch.complex64)
WHOLE = RefinementConfig(softening=1.0)
THINNED = RefinementConfig(softening=1.0, bin_step=2, frame_step=2)
TRUE_DIRECTIONS = (3, 14)


@pytest.fixture
def start() -> AmortizedGuide:
    torch.manual_seed(0)
    guide = AmortizedGuide(VisualNet(K, D, channels=(4, 4)), AudioNet(STEERING_FDM, channels=4))
    return guide.eval()


@pytest.fixture
def data() -> tuple[Tensor, Tensor]:
    """Two talkers who take turns in time and frequency, in noise."""
    torch.manual_seed(1)
    active = (torch.rand(B, len(FREQUENCIES), 1, T) < 0.5).float()
    signal = torch.randn(2, B, len(FREQUENCIES), 1, T, dtype=torch.complex64)
    first, second = (STEERING_FDM[:, d, :, None] for d in TRUE_DIRECTIONS)
    noise = 0.1 * torch.randn(B, len(FREQUENCIES), 4, T, dtype=torch.complex64)
    return first * active * signal[0] + second * (1 - active) * signal[1] + noise, torch.rand(B, 3, 32, 48)


def model(direction_prior: DirectionPrior = LogNormalWeights()) -> SpatialCGMM:  # noqa: B008
    return SpatialCGMM(STEERING_FDM, num_sources=K, direction_prior=direction_prior)


class Plain:
    """A prior that says nothing but what it is."""

    def __call__(self, num_sources: int, num_directions: int, like: Tensor) -> dist.TorchDistribution:
        return dist.LogNormal(like.new_zeros(num_sources, num_directions), 1.0).to_event(2)


def of_no_kind(*_: object) -> dist.TorchDistribution:
    raise NotImplementedError


class Sharp(torch.nn.Module):
    """A start that is sure of three directions."""

    def log_weights(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]:
        mu_bkd = torch.zeros(len(image_bcij), K, D)
        for k in range(K):
            mu_bkd[:, k, k * D // K] = 6.0
        return mu_bkd, mu_bkd[:, :, None]


def mean_loss(guide: torch.nn.Module, data: tuple[Tensor, Tensor]) -> float:
    torch.manual_seed(0)
    with torch.no_grad():
        return Trace_ELBO(num_particles=20, vectorize_particles=True, max_plate_nesting=1)(model(), guide)(*data).item()


def test_every_few_rounds_raise_the_elbo(start: AmortizedGuide, data: tuple[Tensor, Tensor]) -> None:
    guides = [RefinedGuide(start, model(), evolve(WHOLE, rounds=rounds)) for rounds in (2, 6, 40)]
    losses = [mean_loss(guide, data) for guide in (start, *guides)]
    assert losses == sorted(losses, reverse=True)
    assert losses[0] - losses[-1] > 1000


def test_it_finds_both_talkers(start: AmortizedGuide, data: tuple[Tensor, Tensor]) -> None:
    parameters = RefinedGuide(start, model(), evolve(WHOLE, rounds=60)).parameters_of(*data)
    level_bk = parameters.concentration_bk / parameters.concentration_bk.sum(-1, keepdim=True)
    for b in range(B):
        loud = level_bk[b].topk(2).indices
        found = sorted(parameters.mu_bkd[b, loud].argmax(-1).tolist())
        assert found == pytest.approx(TRUE_DIRECTIONS, abs=1)


def test_sites_and_shapes_are_those_of_every_guide(start: AmortizedGuide, data: tuple[Tensor, Tensor]) -> None:
    trace = pyro.poutine.trace(RefinedGuide(start, model(), WHOLE)).get_trace(*data)
    assert trace.nodes["direction_weights"]["value"].shape == (B, K, D)
    assert trace.nodes["mixing_levels"]["value"].shape == (B, K)
    assert {name for name in trace.stochastic_nodes if name != "clip"} == {"direction_weights", "mixing_levels"}


def test_a_quarter_of_the_bins_finds_the_same_sources_and_levels(
    start: AmortizedGuide, data: tuple[Tensor, Tensor]
) -> None:
    whole, thinned = (
        RefinedGuide(start, model(), config).parameters_of(*data)
        for config in (evolve(WHOLE, rounds=60), evolve(THINNED, rounds=60))
    )
    assert thinned.concentration_bk.sum(-1).numpy() == pytest.approx(whole.concentration_bk.sum(-1).numpy(), rel=0.1)
    for parameters in (whole, thinned):
        loud = parameters.concentration_bk.topk(2, dim=-1).indices
        peaks = parameters.mu_bkd.argmax(-1).gather(-1, loud).sort(-1).values
        assert peaks.float().numpy() == pytest.approx(np.array([TRUE_DIRECTIONS] * B), abs=1)
    assert mean_loss(RefinedGuide(start, model(), THINNED), data) < mean_loss(start, data)


def test_a_clip_does_not_depend_on_its_batch(start: AmortizedGuide, data: tuple[Tensor, Tensor]) -> None:
    x_bfmt, image_bcij = data
    guide = RefinedGuide(start, model(), evolve(WHOLE, tolerance=1e-3))
    together = guide.parameters_of(x_bfmt, image_bcij)
    for b in range(B):
        alone = guide.parameters_of(x_bfmt[b : b + 1], image_bcij[b : b + 1])
        torch.testing.assert_close(alone.mu_bkd[0], together.mu_bkd[b], rtol=1e-3, atol=1e-3)
        torch.testing.assert_close(alone.concentration_bk[0], together.concentration_bk[b], rtol=1e-3, atol=1e-2)


def test_more_classes_than_the_networks_have(start: AmortizedGuide, data: tuple[Tensor, Tensor]) -> None:
    more = SpatialCGMM(STEERING_FDM, num_sources=K + 2)
    parameters = RefinedGuide(start, more, evolve(WHOLE, extra_classes=2)).parameters_of(*data)
    assert parameters.mu_bkd.shape == (B, K + 2, D)
    assert parameters.concentration_bk.shape == (B, K + 2)
    assert parameters.activation_bkij.shape[1] == K + 2
    assert torch.isfinite(parameters.mu_bkd).all()


def test_the_picture_pulls_as_hard_as_told(start: AmortizedGuide, data: tuple[Tensor, Tensor]) -> None:
    mu_bkd = start.parameters_of(*data).mu_bkd
    distances = []
    for image_weight, prior_sigma in ((0.0, 1.0), (1.0, 1.0), (1.0, 0.01)):
        config = evolve(WHOLE, image_weight=image_weight)
        refined_bkd = RefinedGuide(start, model(LogNormalWeights(prior_sigma)), config).parameters_of(*data).mu_bkd
        # Only differences between directions matter.
        offset_bkd = refined_bkd - mu_bkd
        distances.append((offset_bkd - offset_bkd.mean(-1, keepdim=True)).square().mean().item())
    assert distances[2] < distances[1] < distances[0]
    assert distances[2] < 0.05


def test_a_softened_start_is_the_networks_own_with_less_conviction(
    start: AmortizedGuide, data: tuple[Tensor, Tensor]
) -> None:
    """With a prior that holds on to the softened start there is nothing else to see of it."""
    mu_bkd = start.parameters_of(*data).mu_bkd
    config = evolve(WHOLE, softening=0.25, image_weight=0.25, rounds=2)
    refined_bkd = RefinedGuide(start, model(LogNormalWeights(1e-3)), config).parameters_of(*data).mu_bkd
    difference_bkd = refined_bkd - 0.25 * mu_bkd
    assert (difference_bkd - difference_bkd.mean(-1, keepdim=True)).abs().max() < 0.01


@pytest.mark.parametrize("name", ["rounds", "bin_step", "frame_step"])
def test_a_setting_of_zero_is_refused_in_a_sentence(name: str) -> None:
    with pytest.raises(InputError, match=f"{name} is 0; it must be at least 1"):
        RefinementConfig(**{name: 0})


def test_silence_stays_finite(start: AmortizedGuide, data: tuple[Tensor, Tensor]) -> None:
    parameters = RefinedGuide(start, model(), WHOLE).parameters_of(torch.zeros_like(data[0]), data[1])
    for value in parameters[:4]:
        assert torch.isfinite(value).all()


@pytest.mark.parametrize(
    ("level_prior", "direction_prior", "likelihood"),
    [
        (SymmetricDirichlet(2.0), LogNormalWeights(2.0), ProfiledGaussian()),
        (SparseDirichlet(), GammaWeights(0.5), ProfiledGaussian()),
        (SparseDirichlet(), HalfNormalWeights(), InverseGammaPsd()),
        (SparseDirichlet(), SpikeAndSlabWeights(), ProfiledGaussian()),
        (SparseDirichlet(), CircularWeights(1.0, 20.0), ProfiledGaussian()),
    ],
    ids=str,
)
def test_it_climbs_the_elbo_of_whatever_model_it_is_given(
    start: AmortizedGuide, data: tuple[Tensor, Tensor], level_prior: Any, direction_prior: Any, likelihood: Any
) -> None:
    of_clips = SpatialCGMM(STEERING_FDM, K, level_prior, direction_prior, likelihood=likelihood)
    elbo = Trace_ELBO(num_particles=20, vectorize_particles=True, max_plate_nesting=1)
    losses = []
    for rounds in (1, 20):
        torch.manual_seed(0)
        guide = RefinedGuide(start, of_clips, evolve(WHOLE, rounds=rounds))
        losses.append(elbo(of_clips, guide)(*data).item())
        loud_b2 = guide.parameters_of(*data).concentration_bk.topk(2, dim=-1).indices
    assert losses[0] - losses[1] > 500
    peaks = guide.parameters_of(*data).mu_bkd.argmax(-1).gather(-1, loud_b2).sort(-1).values
    assert peaks.float().numpy() == pytest.approx(np.array([TRUE_DIRECTIONS] * B), abs=1)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"level_prior": StickBreaking(1.0)}, "the level prior StickBreaking has no 'pseudo_counts'"),
        ({"level_prior": LogisticNormal()}, "LogisticNormal has no 'pseudo_counts'"),
        ({"direction_prior": Plain()}, "the direction prior Plain has no 'of_log_weights'"),
        ({"likelihood": of_no_kind}, "the likelihood of_no_kind has no 'density_generator'"),
        ({"likelihood": FrameActivity()}, "FrameActivity has no 'density_generator'.*use a PerClipGuide"),
    ],
)
def test_what_map_em_cannot_take_in_is_refused(start: AmortizedGuide, changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        RefinedGuide(start, SpatialCGMM(STEERING_FDM, K, **changes))


@pytest.mark.parametrize(
    "direction_prior", [LogNormalWeights(0.1), GammaWeights(50.0), CircularWeights(0.3, 60.0, 0.01)], ids=str
)
def test_it_does_not_stop_where_the_prior_pulls_against_the_likelihood(
    start: AmortizedGuide, data: tuple[Tensor, Tensor], direction_prior: DirectionPrior
) -> None:
    """What rises is likelihood times prior; from a start that the prior dislikes the likelihood alone falls."""
    guide = RefinedGuide(Sharp(), model(direction_prior), RefinementConfig(softening=1.0, rounds=300, tolerance=1e-5))
    found, map_em = guide.parameters_of(*data), map_em_of(guide.model, data[0], Sharp().log_weights(data[1])[0])
    pi_bk = found.concentration_bk / found.concentration_bk.sum(-1, keepdim=True)
    points = [map_em.step(found.mu_bkd, pi_bk)]
    for _ in range(100):
        points.append(map_em.step(points[-1].log_w_bkd, points[-1].pi_bk))
    left_b = (points[-1].objective_b - points[1].objective_b) / points[0].counts_bk.sum(-1)
    assert left_b.max() < 0.01


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (
            lambda start: RefinedGuide(start, SpatialCGMM(STEERING_FDM, K + 2)),
            "the start has 3 source classes.* model 5",
        ),
        (lambda _: RefinedGuide(torch.nn.Identity(), model()), "Identity has no 'log_weights' to start at"),
        (lambda _: RefinementConfig(extra_classes=-1), "extra_classes is -1; it must be at least 0"),
    ],
)
def test_starts_that_do_not_go_with_the_model_are_refused(start: AmortizedGuide, make: Any, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make(start)

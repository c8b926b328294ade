"""MAP-EM: it never falls, it finds what is there, and its spread is that of the posterior."""

from dataclasses import replace
from typing import Any

import numpy as np
import pyro.distributions as dist
import pytest
import torch
from torch import Tensor

from avssl_pyro.acoustics.covariance import template_covariances
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.distributions.e_step import DensityGenerator
from avssl_pyro.distributions.log_weight_priors import (
    GammaLogWeights,
    HalfNormalLogWeights,
    LogWeightPrior,
    NormalLogWeights,
)
from avssl_pyro.distributions.map_em import MapEM
from avssl_pyro.distributions.profiled_gaussian import observe
from avssl_pyro.distributions.spatial_mixture import SpatialMixture
from avssl_pyro.distributions.student_mixture import StudentMixture
from avssl_pyro.models.likelihoods import InverseGammaPsd, ProfiledGaussian
from avssl_pyro.models.priors import (
    CircularWeights,
    GammaWeights,
    HalfNormalWeights,
    LogNormalWeights,
    SpikeAndSlabWeights,
)

D, K, F, T = 24, 3, 12, 30
TRUE_DIRECTIONS = (4, 13)
TEMPLATE_DFMM = template_covariances(FreeField(PRESETS["circle6"])(DirectionGrid(D), np.linspace(300, 3000, F)))


@pytest.fixture
def x_bfmt() -> Tensor:
    """Two clips of two point sources and a diffuse one, drawn from the model itself."""
    torch.manual_seed(0)
    w_kd = torch.full((K, D), 1e-6, dtype=torch.float64)
    for k, d in enumerate(TRUE_DIRECTIONS):
        w_kd[k, d] = 1.0
    w_kd[-1] = 1.0
    pi_k = torch.tensor([0.4, 0.4, 0.2], dtype=torch.float64)
    psd_bfkt = torch.rand(2, F, K, T, dtype=torch.float64) + 0.1
    w_bkd, pi_bk = w_kd.expand(2, K, D), pi_k.expand(2, K)
    return SpatialMixture(TEMPLATE_DFMM, w_bkd, pi_bk, num_frames=T, diffuse=0.02, psd_bfkt=psd_bfkt).sample()


def make_map_em(
    x_bfmt: Tensor, prior: LogWeightPrior | float, alpha: float, diffuse: float = 0.05, weight: float = 1.0
) -> MapEM:
    """With the paper's likelihood; a number is the precision of a normal prior."""
    observed = observe(x_bfmt)
    generator = DensityGenerator(observed.num_microphones, observed.num_microphones * observed.floor_b)
    prior = NormalLogWeights(prior**-0.5) if isinstance(prior, float) else prior
    return MapEM(observed, TEMPLATE_DFMM, diffuse, generator, prior, alpha, weight)


def start() -> tuple[Tensor, Tensor]:
    torch.manual_seed(1)
    return torch.randn(2, K, D, dtype=torch.float64), torch.full((2, K), 1 / K, dtype=torch.float64)


class Ramp:
    """A prior of a user's own: log w with a mean that falls from one end of the grid to the other."""

    def __str__(self) -> str:
        return "Ramp()"

    def mean(self, num_directions: int, like: Tensor) -> Tensor:
        return torch.linspace(0.0, -4.0, num_directions).to(like)

    def __call__(self, num_sources: int, num_directions: int, like: Tensor) -> dist.TorchDistribution:
        return dist.LogNormal(self.mean(num_directions, like).expand(num_sources, -1), 1.0).to_event(2)

    def of_log_weights(self, num_directions: int, like: Tensor) -> LogWeightPrior:
        return NormalLogWeights(1.0, self.mean(num_directions, like))


@pytest.mark.parametrize(
    "direction_prior",
    [
        Ramp(),
        LogNormalWeights(1e6),
        LogNormalWeights(1.0),
        LogNormalWeights(0.1),
        GammaWeights(0.5),
        HalfNormalWeights(1.0),
        SpikeAndSlabWeights(),
        CircularWeights(1.0, 30.0),
    ],
    ids=str,
)
@pytest.mark.parametrize("likelihood", [ProfiledGaussian(), InverseGammaPsd(0.5, 0.1)], ids=str)
def test_likelihood_plus_prior_never_falls(
    x_bfmt: Tensor, direction_prior: Any, likelihood: ProfiledGaussian | InverseGammaPsd
) -> None:
    observed, like = observe(x_bfmt), start()[0]
    prior = direction_prior.of_log_weights(D, like)
    map_em = MapEM(observed, TEMPLATE_DFMM, 0.05, likelihood.density_generator(observed), prior, alpha=0.0)
    log_w_bkd, pi_bk = start()
    log_w_bkd = log_w_bkd + prior.shift(log_w_bkd)
    objectives = []
    for _ in range(25):
        point = map_em.step(log_w_bkd, pi_bk)
        log_prior_b = direction_prior(K, D, like).log_prob(log_w_bkd.exp()) + log_w_bkd.sum((-2, -1))
        objectives.append(point.log_likelihood_b + log_prior_b)
        log_w_bkd, pi_bk = point.log_w_bkd, point.pi_bk
    rises = torch.stack(objectives).diff(dim=0)
    assert rises.min() > -1e-9 * objectives[0].abs().max()
    assert rises.sum(0).min() > 1.0


def test_the_students_likelihood_is_reported_too(x_bfmt: Tensor) -> None:
    likelihood, observed = InverseGammaPsd(0.8, 0.3), observe(x_bfmt)
    prior = NormalLogWeights()
    map_em = MapEM(observed, TEMPLATE_DFMM, 0.05, likelihood.density_generator(observed), prior, alpha=0.0)
    (first_w, pi_bk), second_w = start(), torch.zeros(2, K, D).double()
    expected = [likelihood(TEMPLATE_DFMM, w.exp(), pi_bk, T, 0.05).log_prob(x_bfmt) for w in (first_w, second_w)]
    found = [map_em.step(w, pi_bk).log_likelihood_b for w in (first_w, second_w)]
    torch.testing.assert_close(found[0] - found[1], expected[0] - expected[1])


def test_the_reported_likelihood_is_that_of_the_mixture(x_bfmt: Tensor) -> None:
    map_em = make_map_em(x_bfmt, 1.0, alpha=0.0)
    (first_w, first_pi), (second_w, second_pi) = start(), (torch.zeros(2, K, D).double(), start()[1])
    expected, found = (
        [evaluate(first_w, first_pi), evaluate(second_w, second_pi)]
        for evaluate in (
            lambda w, pi: SpatialMixture(TEMPLATE_DFMM, w.exp(), pi, num_frames=T, diffuse=0.05).log_prob(x_bfmt),
            lambda w, pi: map_em.step(w, pi).log_likelihood_b,
        )
    )
    # Up to a constant of the clip.
    torch.testing.assert_close(found[0] - found[1], expected[0] - expected[1])


def test_it_finds_the_sources_and_their_levels(x_bfmt: Tensor) -> None:
    map_em = make_map_em(x_bfmt, 0.1, alpha=0.01, diffuse=0.02)
    log_w_bkd = torch.full((2, K, D), -1.0, dtype=torch.float64)
    # As the networks would: roughly there, and one class for the rest.
    for k, d in enumerate(TRUE_DIRECTIONS):
        log_w_bkd[:, k, d - 2 : d + 3] = 0.0
    pi_bk = start()[1]
    for _ in range(40):
        point = map_em.step(log_w_bkd, pi_bk)
        log_w_bkd, pi_bk = point.log_w_bkd, point.pi_bk
    assert log_w_bkd[:, : len(TRUE_DIRECTIONS)].argmax(-1).tolist() == [list(TRUE_DIRECTIONS)] * 2
    assert pi_bk.numpy() == pytest.approx(np.array([[0.4, 0.4, 0.2]] * 2), abs=0.1)


def test_silence_stays_finite() -> None:
    silent = torch.zeros(1, F, 6, T, dtype=torch.complex128)
    map_em = make_map_em(silent, 4.0, alpha=0.01)
    point = map_em.step(torch.zeros(1, K, D).double(), torch.full((1, K), 1 / K).double())
    assert torch.isfinite(point.log_w_bkd).all()
    assert torch.isfinite(point.log_likelihood_b).all()


def test_a_weight_is_so_many_copies_of_every_frame(x_bfmt: Tensor) -> None:
    thrice = x_bfmt.repeat_interleave(3, dim=-1)
    fits = make_map_em(x_bfmt, 2.0, alpha=0.5, weight=3.0), make_map_em(thrice, 2.0, alpha=0.5)
    weighted, copied = (map_em.step(*start()) for map_em in fits)
    torch.testing.assert_close(weighted.log_w_bkd, copied.log_w_bkd)
    torch.testing.assert_close(weighted.counts_bk, copied.counts_bk)
    torch.testing.assert_close(weighted.log_likelihood_b, copied.log_likelihood_b)
    for found, expected in zip(fits[0].uncertainty(weighted), fits[1].uncertainty(copied), strict=True):
        torch.testing.assert_close(found, expected)


def test_more_data_means_less_spread(x_bfmt: Tensor) -> None:
    spreads = []
    for frames in (T // 3, T):
        map_em = make_map_em(x_bfmt[..., :frames], 1.0, alpha=0.01)
        spreads.append(map_em.uncertainty(map_em.step(*start()))[0].mean().item())
    assert spreads[1] < spreads[0] < 1.0


@pytest.mark.parametrize("likelihood", [ProfiledGaussian(), InverseGammaPsd(0.7, 0.4)], ids=str)
def test_the_spread_is_that_of_the_expected_information(likelihood: ProfiledGaussian | InverseGammaPsd) -> None:
    """Of one class the information is the variance of the score over data drawn from the model."""
    torch.manual_seed(0)
    frames, prior_precision = 4000, 5.0
    log_w_11d = 0.5 * torch.randn(1, 1, D, dtype=torch.float64)
    pi_bk = torch.ones(1, 1, dtype=torch.float64)
    student = StudentMixture(
        TEMPLATE_DFMM, log_w_11d.exp(), pi_bk, num_frames=frames, psd_shape=0.7, psd_scale=0.4, diffuse=0.05
    )
    # The angular central Gaussian is that of every power, so these draws serve for both.
    x_bfmt, log_w = student.sample(), log_w_11d.requires_grad_()
    per_bin = likelihood(TEMPLATE_DFMM, log_w.exp(), pi_bk, frames, 0.05).component_log_prob(x_bfmt)[0, :, 0]
    chunks = per_bin.unflatten(-1, (-1, 10)).sum((0, -1))
    scores = torch.stack([torch.autograd.grad(chunk, log_w, retain_graph=True)[0][0, 0] for chunk in chunks])
    information_d = scores.square().mean(0) * (frames / 10)
    observed = observe(x_bfmt)
    prior = NormalLogWeights(prior_precision**-0.5)
    map_em = MapEM(observed, TEMPLATE_DFMM, 0.05, likelihood.density_generator(observed), prior, alpha=0.0)
    point = map_em.step(log_w.detach(), pi_bk)
    at_the_truth = replace(point, log_w_bkd=log_w.detach())
    expected_d = (information_d + prior_precision).rsqrt()
    assert map_em.uncertainty(at_the_truth)[0][0, 0].numpy() == pytest.approx(expected_d.numpy(), rel=0.2)


@pytest.mark.parametrize("prior", [GammaLogWeights(0.5), HalfNormalLogWeights(1.0)], ids=str)
def test_silent_directions_spread_far_under_priors_that_let_them(x_bfmt: Tensor, prior: LogWeightPrior) -> None:
    map_em = make_map_em(x_bfmt, prior, alpha=0.01)
    log_w_bkd, pi_bk = start()
    for _ in range(20):
        point = map_em.step(log_w_bkd, pi_bk)
        log_w_bkd, pi_bk = point.log_w_bkd, point.pi_bk
    spread_bkd, _ = map_em.uncertainty(point)
    assert spread_bkd.isfinite().all()
    assert spread_bkd.max() <= 4.0
    quiet, loud = log_w_bkd.flatten().argsort()[[0, -1]]
    assert spread_bkd.flatten()[quiet] > spread_bkd.flatten()[loud]


def test_counts_are_worth_less_where_classes_look_alike(x_bfmt: Tensor) -> None:
    map_em, (_, pi_bk) = make_map_em(x_bfmt, 1.0, alpha=0.5), start()
    worth = []
    for contrast in (0.0, 0.3, 6.0):
        log_w_bkd = torch.zeros(2, K, D, dtype=torch.float64)
        for k, d in enumerate(TRUE_DIRECTIONS):
            log_w_bkd[:, k, d] = contrast
        point = map_em.step(log_w_bkd, pi_bk)
        at_the_start = replace(point, log_w_bkd=log_w_bkd)
        concentration_bk = map_em.uncertainty(at_the_start)[1]
        worth.append(concentration_bk.sum(-1).mean().item())
        # However little they tell, the levels stay what they are.
        torch.testing.assert_close(concentration_bk / concentration_bk.sum(-1, keepdim=True), at_the_start.pi_bk)
    assert worth[0] == pytest.approx(0.01 * (F * T + 0.5 * K))
    assert worth[0] < worth[1] < worth[2] < F * T + 0.5 * K

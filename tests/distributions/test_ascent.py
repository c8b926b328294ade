"""The closed-form ascent: it never falls, it finds what is there, and its spread is that of the posterior."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from avssl_pyro.acoustics.covariance import template_covariances
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.distributions.ascent import LogWeightPrior, MixtureAscent
from avssl_pyro.distributions.profiled_gaussian import observe
from avssl_pyro.distributions.spatial_mixture import SpatialMixture

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


def prior(precision: float) -> LogWeightPrior:
    zero = torch.zeros((), dtype=torch.float64)
    return LogWeightPrior(zero, zero + precision)


def start() -> tuple[Tensor, Tensor]:
    torch.manual_seed(1)
    return torch.randn(2, K, D, dtype=torch.float64), torch.full((2, K), 1 / K, dtype=torch.float64)


@pytest.mark.parametrize("precision", [1e-12, 1.0, 100.0])
def test_likelihood_plus_prior_never_falls(x_bfmt: Tensor, precision: float) -> None:
    ascent = MixtureAscent(observe(x_bfmt), TEMPLATE_DFMM, 0.05, prior(precision), alpha=0.0)
    log_w_bkd, pi_bk = start()
    log_w_bkd = log_w_bkd - log_w_bkd.mean(-1, keepdim=True)
    objectives = []
    for _ in range(25):
        point = ascent.step(log_w_bkd, pi_bk)
        objectives.append(point.log_likelihood_b - 0.5 * precision * log_w_bkd.square().sum((-2, -1)))
        log_w_bkd, pi_bk = point.log_w_bkd, point.pi_bk
    rises = torch.stack(objectives).diff(dim=0)
    assert rises.min() > -1e-9 * objectives[0].abs().max()
    assert rises.sum(0).min() > 1.0


def test_the_reported_likelihood_is_that_of_the_mixture(x_bfmt: Tensor) -> None:
    ascent = MixtureAscent(observe(x_bfmt), TEMPLATE_DFMM, 0.05, prior(1.0), alpha=0.0)
    (first_w, first_pi), (second_w, second_pi) = start(), (torch.zeros(2, K, D).double(), start()[1])
    expected, found = (
        [evaluate(first_w, first_pi), evaluate(second_w, second_pi)]
        for evaluate in (
            lambda w, pi: SpatialMixture(TEMPLATE_DFMM, w.exp(), pi, num_frames=T, diffuse=0.05).log_prob(x_bfmt),
            lambda w, pi: ascent.step(w, pi).log_likelihood_b,
        )
    )
    # Up to a constant of the clip.
    torch.testing.assert_close(found[0] - found[1], expected[0] - expected[1])


def test_it_finds_the_sources_and_their_levels(x_bfmt: Tensor) -> None:
    ascent = MixtureAscent(observe(x_bfmt), TEMPLATE_DFMM, 0.02, prior(0.1), alpha=0.01)
    log_w_bkd = torch.full((2, K, D), -1.0, dtype=torch.float64)
    # As the networks would: roughly there, and one class for the rest.
    for k, d in enumerate(TRUE_DIRECTIONS):
        log_w_bkd[:, k, d - 2 : d + 3] = 0.0
    pi_bk = start()[1]
    for _ in range(40):
        point = ascent.step(log_w_bkd, pi_bk)
        log_w_bkd, pi_bk = point.log_w_bkd, point.pi_bk
    assert log_w_bkd[:, : len(TRUE_DIRECTIONS)].argmax(-1).tolist() == [list(TRUE_DIRECTIONS)] * 2
    assert pi_bk.numpy() == pytest.approx(np.array([[0.4, 0.4, 0.2]] * 2), abs=0.1)


def test_silence_stays_finite() -> None:
    silent = torch.zeros(1, F, 6, T, dtype=torch.complex128)
    ascent = MixtureAscent(observe(silent), TEMPLATE_DFMM, 0.05, prior(4.0), alpha=0.01)
    point = ascent.step(torch.zeros(1, K, D).double(), torch.full((1, K), 1 / K).double())
    assert torch.isfinite(point.log_w_bkd).all()
    assert torch.isfinite(point.log_likelihood_b).all()


def test_a_weight_is_so_many_copies_of_every_frame(x_bfmt: Tensor) -> None:
    thrice = x_bfmt.repeat_interleave(3, dim=-1)
    weighted = MixtureAscent(observe(x_bfmt), TEMPLATE_DFMM, 0.05, prior(2.0), alpha=0.5, weight=3.0).step(*start())
    copied = MixtureAscent(observe(thrice), TEMPLATE_DFMM, 0.05, prior(2.0), alpha=0.5).step(*start())
    torch.testing.assert_close(weighted.log_w_bkd, copied.log_w_bkd)
    torch.testing.assert_close(weighted.precision_bkd, copied.precision_bkd)
    torch.testing.assert_close(weighted.counts_bk, copied.counts_bk)
    torch.testing.assert_close(weighted.log_likelihood_b, copied.log_likelihood_b)


def test_more_data_means_less_spread(x_bfmt: Tensor) -> None:
    spreads = []
    for frames in (T // 3, T):
        ascent = MixtureAscent(observe(x_bfmt[..., :frames]), TEMPLATE_DFMM, 0.05, prior(1.0), alpha=0.01)
        spreads.append(ascent.step(*start()).precision_bkd.rsqrt().mean().item())
    assert spreads[1] < spreads[0] < math.inf

"""The priors: what each says of a draw, and that the ascent's version of each is the same density over log w."""

import math

import pytest
import torch
from torch import Tensor

from avssl_pyro.errors import InputError
from avssl_pyro.models.priors import (
    CircularWeights,
    DirectionPrior,
    GammaWeights,
    HalfNormalWeights,
    LevelPrior,
    LogisticNormal,
    LogNormalWeights,
    SparseDirichlet,
    SpikeAndSlabWeights,
    StickBreaking,
    SymmetricDirichlet,
)

K, D = 3, 24
LEVEL_PRIORS = (SparseDirichlet(), SymmetricDirichlet(), StickBreaking(), LogisticNormal())
DIRECTION_PRIORS = (
    LogNormalWeights(0.7),
    GammaWeights(0.6),
    HalfNormalWeights(1.4),
    SpikeAndSlabWeights(0.2, 3.0, 0.8),
    CircularWeights(0.9, 25.0, 0.2),
)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("prior", DIRECTION_PRIORS, ids=str)
def test_direction_priors_follow_dtype_and_shape(prior: DirectionPrior, dtype: torch.dtype) -> None:
    torch.manual_seed(0)
    weights = prior(K, D, torch.zeros((), dtype=dtype))
    w = weights.expand([5]).sample()
    assert (weights.event_shape, w.shape, w.dtype) == ((K, D), (5, K, D), dtype)
    assert (w > 0).all()
    assert weights.expand([5]).log_prob(w).shape == (5,)


@pytest.mark.parametrize("num_sources", [1, 2, 5])
@pytest.mark.parametrize("prior", LEVEL_PRIORS, ids=str)
def test_level_priors_work_for_any_number_of_classes(prior: LevelPrior, num_sources: int) -> None:
    torch.manual_seed(0)
    levels = prior(num_sources, torch.zeros((), dtype=torch.float64)).expand([5])
    pi = levels.sample()
    assert pi.shape == (5, num_sources)
    torch.testing.assert_close(pi.sum(-1), torch.ones(5, dtype=torch.float64))
    assert levels.log_prob(pi).isfinite().all()


def log_density(prior: DirectionPrior, log_w_bkd: Tensor) -> Tensor:
    """Of log w, summed over the batch."""
    return (prior(K, D, log_w_bkd).log_prob(log_w_bkd.exp()) + log_w_bkd.sum((-2, -1))).sum()


@pytest.mark.parametrize("prior", DIRECTION_PRIORS, ids=str)
def test_the_ascent_sees_the_gradient_of_the_prior(prior: DirectionPrior) -> None:
    torch.manual_seed(0)
    log_w_bkd = torch.randn(2, K, D, dtype=torch.float64, requires_grad=True)
    (expected,) = torch.autograd.grad(log_density(prior, log_w_bkd), log_w_bkd)
    of_log_weights = prior.of_log_weights(D, log_w_bkd)  # type: ignore[attr-defined]
    torch.testing.assert_close(of_log_weights.gradient(log_w_bkd.detach()), expected)


@pytest.mark.parametrize("prior", DIRECTION_PRIORS, ids=str)
def test_the_shift_is_uphill_and_the_prior_likes_no_other_better(prior: DirectionPrior) -> None:
    torch.manual_seed(0)
    log_w_bkd = 2 + torch.randn(2, K, D, dtype=torch.float64)
    of_log_weights = prior.of_log_weights(D, log_w_bkd)  # type: ignore[attr-defined]
    before = log_density(prior, log_w_bkd)
    for _ in range(60):
        log_w_bkd = log_w_bkd + of_log_weights.shift(log_w_bkd)
        after = log_density(prior, log_w_bkd)
        assert after > before - 1e-9 * before.abs()
        before = after
    for step in (-0.01, 0.01):
        assert log_density(prior, log_w_bkd + step) < before


@pytest.mark.parametrize("prior", DIRECTION_PRIORS, ids=str)
def test_newton_steps_alone_climb_to_the_mode_of_the_prior(prior: DirectionPrior) -> None:
    torch.manual_seed(0)
    log_w_bkd = torch.randn(2, K, D, dtype=torch.float64)
    of_log_weights = prior.of_log_weights(D, log_w_bkd)  # type: ignore[attr-defined]
    for _ in range(300):
        gradient = of_log_weights.gradient(log_w_bkd)
        step = of_log_weights.newton_step(gradient, torch.full_like(gradient, 1e-3), log_w_bkd)
        log_w_bkd = log_w_bkd + step.clamp(-1, 1)
    assert of_log_weights.gradient(log_w_bkd).abs().max() < 1e-6


def test_neighbours_share_under_the_circular_prior_also_across_the_seam() -> None:
    torch.manual_seed(0)
    log_w_nkd = CircularWeights(sigma=1.5, width_deg=30.0, rough=0.05)(K, D, torch.zeros(())).sample((4000,)).log()
    by_distance = [(log_w_nkd * log_w_nkd.roll(shift, -1)).mean((0, 1)) for shift in (0, 1, 6)]
    # 15 degrees apart: sigma^2 (1 - rough) exp((cos 15 - 1) / width^2); 90 degrees apart: nearly nothing.
    near = 1.5**2 * 0.95 * math.exp((math.cos(math.pi / 12) - 1) / math.radians(30) ** 2)
    for covariance_d, expected in zip(by_distance, (2.25, near, 0.06), strict=True):
        assert covariance_d.numpy() == pytest.approx(expected, abs=0.15)


def test_most_directions_of_a_spike_and_slab_draw_are_quiet() -> None:
    torch.manual_seed(0)
    log_w = SpikeAndSlabWeights(share=0.1, depth=8.0, sigma=0.5)(K, D, torch.zeros(())).sample((1000,)).log()
    assert (log_w > -4).float().mean().item() == pytest.approx(0.1, abs=0.01)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: SymmetricDirichlet(0.0), "alpha is 0.0; it must be positive"),
        (lambda: StickBreaking(-1.0), "concentration is -1.0; it must be positive"),
        (lambda: LogisticNormal(math.inf), "sigma is inf; it must be positive"),
        (lambda: GammaWeights(math.nan), "shape is nan; it must be positive"),
        (lambda: HalfNormalWeights(0), "sigma is 0; it must be positive"),
        (lambda: SpikeAndSlabWeights(share=1.0), "share is 1.0; it must be between 0 and 1"),
        (lambda: CircularWeights(rough=0.0), "rough is 0.0; it must be from 0.001 to 1"),
        (lambda: CircularWeights(width_deg=-5.0), "width_deg is -5.0; it must be positive"),
    ],
)
def test_priors_that_cannot_be_are_refused(make: object, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make()  # type: ignore[operator]

"""Distributions of mixing levels: densities that integrate to one and agree with their own draws."""

import numpy as np
import pytest
import torch
from hypothesis import assume, given
from hypothesis import strategies as st
from torch import Tensor
from torch.distributions import Beta

from avssl_pyro.distributions.simplex import AdditiveLogRatio, TruncatedStickBreaking
from avssl_pyro.models.priors import LevelPrior, LogisticNormal, SparseDirichlet, StickBreaking, SymmetricDirichlet

LIKE = torch.zeros((), dtype=torch.float64)


def simplex_grid(cells: int) -> tuple[Tensor, float]:
    """Midpoints of a grid of triangles over the levels of three classes, (N, 3), and the area of a cell."""
    index = np.arange(cells)
    lower = np.stack(np.meshgrid(index, index, indexing="ij"), -1).reshape(-1, 2)
    upward = lower[lower.sum(-1) < cells] + 1 / 3
    downward = lower[lower.sum(-1) < cells - 1] + 2 / 3
    first_two = np.concatenate([upward, downward]) / cells
    levels = np.concatenate([first_two, 1 - first_two.sum(-1, keepdims=True)], -1)
    return torch.from_numpy(levels), 0.5 / cells**2


@pytest.mark.parametrize(
    "prior",
    [SymmetricDirichlet(1.0), SymmetricDirichlet(3.0), StickBreaking(1.0), StickBreaking(2.5), LogisticNormal(0.7)],
    ids=str,
)
def test_densities_of_levels_integrate_to_one(prior: LevelPrior) -> None:
    levels_nk, area = simplex_grid(200)
    total = prior(3, LIKE).log_prob(levels_nk).exp().sum() * area
    assert total.item() == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("prior", [StickBreaking(0.8), StickBreaking(2.5), LogisticNormal(0.7)], ids=str)
def test_draws_of_levels_have_the_mean_of_the_density(prior: LevelPrior) -> None:
    torch.manual_seed(0)
    levels_nk, area = simplex_grid(300)
    distribution = prior(3, LIKE)
    expected = (distribution.log_prob(levels_nk).exp()[:, None] * levels_nk).sum(0) * area
    drawn = distribution.sample((20_000,))
    assert drawn.sum(-1).numpy() == pytest.approx(np.ones(20_000))
    assert drawn.mean(0).numpy() == pytest.approx(expected.numpy(), abs=0.02)


@given(st.integers(2, 6), st.floats(0.5, 5.0), st.integers(0, 2**32 - 1))
def test_stick_breaking_is_its_sticks_and_their_jacobian(num: int, concentration: float, seed: int) -> None:
    torch.manual_seed(seed)
    distribution = TruncatedStickBreaking(LIKE + concentration, num)
    levels = distribution.sample()
    rest = torch.cat([torch.ones(1, dtype=torch.float64), 1 - levels.cumsum(-1)[:-1]])
    # Written out like this, remainders below it are rounding.
    assume(rest[:-1].min() > 1e-8)
    sticks = (levels / rest)[:-1]
    by_hand = Beta(1.0, LIKE + concentration).log_prob(sticks.clamp(1e-12, 1 - 1e-12)).sum() - rest[:-1].log().sum()
    assert distribution.log_prob(levels).item() == pytest.approx(by_hand.item(), rel=1e-5, abs=1e-5)


@given(st.integers(2, 6), st.integers(0, 2**32 - 1))
def test_log_ratios_there_and_back(num: int, seed: int) -> None:
    torch.manual_seed(seed)
    transform, ratio = AdditiveLogRatio(), 3 * torch.randn(4, num - 1, dtype=torch.float64)
    levels = transform(ratio)
    torch.testing.assert_close(transform.inv(levels), ratio)
    jacobian = torch.autograd.functional.jacobian(lambda y: transform(y)[:-1], ratio[0])
    expected = torch.linalg.slogdet(jacobian).logabsdet
    torch.testing.assert_close(transform.log_abs_det_jacobian(ratio, levels)[0], expected)


def test_logistic_normal_treats_all_classes_alike() -> None:
    distribution = LogisticNormal(1.3)(4, LIKE)
    levels = torch.tensor([0.1, 0.2, 0.3, 0.4], dtype=torch.float64)
    torch.testing.assert_close(distribution.log_prob(levels), distribution.log_prob(levels.flip(-1)))


@pytest.mark.parametrize("prior", [StickBreaking(0.1), LogisticNormal(20.0), SparseDirichlet(0.01)], ids=str)
def test_extreme_draws_keep_a_finite_density_in_single_precision(prior: LevelPrior) -> None:
    torch.manual_seed(0)
    distribution = prior(8, torch.zeros(()))
    drawn = distribution.sample((500,))
    assert distribution.log_prob(drawn).isfinite().all()

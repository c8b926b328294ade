"""The prior of directions and diffuse components: gradients, and the scale of greatest density."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from avssl_pyro.distributions.diffuse_prior import DirectionsAndDiffuse
from avssl_pyro.models.priors import CircularWeights, GammaWeights, HalfNormalWeights, LogNormalWeights

D, C, K = 8, 2, 3
PRIORS = [LogNormalWeights(0.7), GammaWeights(0.5), HalfNormalWeights(), CircularWeights(1.0, 30.0)]


def make(prior: LogNormalWeights | GammaWeights | HalfNormalWeights | CircularWeights) -> DirectionsAndDiffuse:
    like = torch.zeros((), dtype=torch.float64)
    return DirectionsAndDiffuse(prior.of_log_weights(D, like), C, mean=2.0, sigma=2.0)


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 1000), st.sampled_from(PRIORS))
def test_gradient_is_that_of_the_density(seed: int, prior: LogNormalWeights) -> None:
    generator = torch.Generator().manual_seed(seed)
    log_w_bkd = torch.randn(1, K, D + C, generator=generator, dtype=torch.float64, requires_grad=True)
    (gradient_bkd,) = torch.autograd.grad(make(prior).log_density(log_w_bkd).sum(), log_w_bkd)
    torch.testing.assert_close(make(prior).gradient(log_w_bkd.detach()), gradient_bkd)


@pytest.mark.parametrize("prior", PRIORS, ids=str)
def test_no_other_scale_near_the_shift_has_greater_density(prior: LogNormalWeights) -> None:
    torch.manual_seed(0)
    log_w_bkd = 0.5 * torch.randn(1, K, D + C, dtype=torch.float64)
    joint = make(prior)
    at_best = joint.log_density(log_w_bkd + joint.shift(log_w_bkd))
    assert at_best >= joint.log_density(log_w_bkd)
    if isinstance(prior, LogNormalWeights):
        for change in (-0.01, 0.01):
            assert at_best > joint.log_density(log_w_bkd + joint.shift(log_w_bkd) + change)

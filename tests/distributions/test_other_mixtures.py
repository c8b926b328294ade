"""Mixtures with other likelihoods: by hand, by integrating their latents numerically, and by their own draws."""

import itertools
import math

import numpy as np
import pytest
import torch
from scipy.integrate import quad
from torch import Tensor

from avssl_pyro.acoustics.covariance import template_covariances
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.distributions.activity_mixture import ActivityMixture
from avssl_pyro.distributions.spatial_mixture import SpatialMixture
from avssl_pyro.distributions.student_mixture import StudentMixture

B, F, D, M, K, T = 2, 3, 8, 4, 3, 5
TEMPLATE_DFMM = template_covariances(FreeField(PRESETS["circle4"])(DirectionGrid(D), np.array([500.0, 1000.0, 2000.0])))


@pytest.fixture
def latents() -> tuple[Tensor, Tensor]:
    torch.manual_seed(0)
    return torch.rand(B, K, D, dtype=torch.float64) + 0.01, torch.rand(B, K, dtype=torch.float64).softmax(-1)


@pytest.fixture
def x_bfmt() -> Tensor:
    torch.manual_seed(1)
    return 0.3 * torch.randn(B, F, M, T, dtype=torch.complex128)


def student(latents: tuple[Tensor, Tensor], shape: float = 1.5, scale: float = 0.2) -> StudentMixture:
    return StudentMixture(TEMPLATE_DFMM, *latents, num_frames=T, psd_shape=shape, psd_scale=scale)


def activity(latents: tuple[Tensor, Tensor], probability: float = 0.3) -> ActivityMixture:
    return ActivityMixture(TEMPLATE_DFMM, *latents, num_frames=T, activity=probability)


def test_a_student_component_is_a_gaussian_with_its_power_integrated_over(
    latents: tuple[Tensor, Tensor], x_bfmt: Tensor
) -> None:
    shape, scale = 1.5, 0.2
    found = student(latents, shape, scale).component_log_prob(x_bfmt)

    def integrand(log_psd: float) -> float:
        """p(x | lambda) InvGamma(lambda) d lambda, over log lambda."""
        psd_bfkt = torch.full((B, F, K, T), math.exp(log_psd), dtype=torch.float64)
        given = SpatialMixture(TEMPLATE_DFMM, *latents, num_frames=T, psd_bfkt=psd_bfkt).component_log_prob(x_bfmt)
        prior = shape * math.log(scale) - math.lgamma(shape) - shape * log_psd - scale * math.exp(-log_psd)
        return math.exp(given[1, 2, 0, 3].item() + prior)

    expected, _ = quad(integrand, -12.0, 12.0, limit=400)
    assert found[1, 2, 0, 3].item() == pytest.approx(math.log(expected), abs=1e-6)


def test_jeffreys_prior_of_the_power_is_the_papers_profile(latents: tuple[Tensor, Tensor], x_bfmt: Tensor) -> None:
    """Up to a constant, the power spectral density profiled out (Eq. 16) and integrated over come to the same."""
    profiled = SpatialMixture(TEMPLATE_DFMM, *latents, num_frames=T).log_prob(x_bfmt)
    vague = student(latents, 1e-9, 1e-9).log_prob(x_bfmt)
    other = latents[0].flip(-1), latents[1].flip(-1)
    profiled_other = SpatialMixture(TEMPLATE_DFMM, *other, num_frames=T).log_prob(x_bfmt)
    torch.testing.assert_close(vague - student(other, 1e-9, 1e-9).log_prob(x_bfmt), profiled - profiled_other)


def test_student_draws_are_heavier_tailed_and_have_the_posterior_masks_of_their_classes(
    latents: tuple[Tensor, Tensor],
) -> None:
    torch.manual_seed(0)
    mixture = student(latents, shape=3.0, scale=2.0)
    x_sbfmt = mixture.sample((4000,))
    # E x x^H = E lambda sum_k pi_k H_k, with E lambda = scale / (shape - 1) = 1.
    expected_bfmn = torch.einsum("bk,bkfmn->bfmn", latents[1].to(x_sbfmt.dtype), mixture.scm_bkfmm)
    found_bfmn = torch.einsum("sbfmt,sbfnt->bfmn", x_sbfmt, x_sbfmt.conj()) / (4000 * T)
    assert (found_bfmn - expected_bfmn).abs().max() < 0.15 * expected_bfmn.abs().max()
    mask_k = mixture.masks(x_sbfmt).mean((0, 2, 4))
    assert mask_k.numpy() == pytest.approx(latents[1].numpy(), abs=0.02)


def test_silence_has_a_finite_student_likelihood_and_gradient(latents: tuple[Tensor, Tensor]) -> None:
    w_bkd = latents[0].float().requires_grad_()
    mixture = StudentMixture(
        TEMPLATE_DFMM.to(torch.complex64), w_bkd, latents[1].float(), num_frames=T, psd_shape=0.5, psd_scale=1e-3
    )
    log_prob = mixture.log_prob(torch.zeros(B, F, M, T, dtype=torch.complex64))
    assert log_prob.isfinite().all()
    log_prob.sum().backward()
    assert w_bkd.grad is not None
    assert w_bkd.grad.isfinite().all()


def test_activity_sums_over_every_pattern_of_every_frame(latents: tuple[Tensor, Tensor], x_bfmt: Tensor) -> None:
    probability, (w_bkd, pi_bk) = 0.3, latents
    component_bfkt = SpatialMixture(TEMPLATE_DFMM, w_bkd, pi_bk, num_frames=T).component_log_prob(x_bfmt)
    frames = []
    for pattern in list(itertools.product((0.0, 1.0), repeat=K))[1:]:
        on_k = torch.tensor(pattern, dtype=torch.float64)
        level_bk = on_k * pi_bk / (on_k * pi_bk).sum(-1, keepdim=True)
        given_bt = (level_bk.log()[:, None, :, None] + component_bfkt).logsumexp(-2).sum(-2)
        odds = math.prod(probability if on else 1 - probability for on in pattern) / (1 - (1 - probability) ** K)
        frames.append(given_bt + math.log(odds))
    expected_b = torch.stack(frames).logsumexp(0).sum(-1)
    torch.testing.assert_close(activity(latents, probability).log_prob(x_bfmt), expected_b)


def test_patterns_with_too_many_classes_on_are_ruled_out(latents: tuple[Tensor, Tensor], x_bfmt: Tensor) -> None:
    """With one class at a time a frame belongs to one class."""
    single = ActivityMixture(TEMPLATE_DFMM, *latents, num_frames=T, activity=0.3, most_active=1)
    component_bfkt = SpatialMixture(TEMPLATE_DFMM, *latents, num_frames=T).component_log_prob(x_bfmt)
    expected_b = (component_bfkt.sum(-3).logsumexp(-2) - math.log(K)).sum(-1)
    torch.testing.assert_close(single.log_prob(x_bfmt), expected_b)
    torch.testing.assert_close(single.active(x_bfmt).sum(-2), torch.ones(B, T, dtype=torch.float64))


def test_classes_that_are_nearly_always_on_are_the_papers_mixture(
    latents: tuple[Tensor, Tensor], x_bfmt: Tensor
) -> None:
    expected = SpatialMixture(TEMPLATE_DFMM, *latents, num_frames=T)
    found = activity(latents, 1 - 1e-12)
    torch.testing.assert_close(found.log_prob(x_bfmt), expected.log_prob(x_bfmt))
    torch.testing.assert_close(found.masks(x_bfmt), expected.masks(x_bfmt))
    assert found.active(x_bfmt).min() > 1 - 1e-6


def test_activity_is_found_where_it_was_drawn(latents: tuple[Tensor, Tensor]) -> None:
    torch.manual_seed(0)
    w_bkd = torch.full((1, 2, D), 1e-6, dtype=torch.float64)
    w_bkd[0, 0, 1] = w_bkd[0, 1, 5] = 1.0
    pi_bk = torch.full((1, 2), 0.5, dtype=torch.float64)
    psd_bfkt = torch.ones(1, F, 2, 2000, dtype=torch.float64)
    mixture = ActivityMixture(
        TEMPLATE_DFMM, w_bkd, pi_bk, num_frames=2000, activity=0.3, diffuse=0.01, psd_bfkt=psd_bfkt
    )
    active_kt = mixture.active(mixture.sample())[0]
    # Of the three patterns with sound, each class is in two: 0.3 * 0.7 + 0.3 * 0.3 of 1 - 0.7 * 0.7.
    assert active_kt.mean(-1).numpy() == pytest.approx(0.3 / 0.51, abs=0.03)
    assert ((active_kt < 0.1) | (active_kt > 0.9)).double().mean() > 0.8


@pytest.mark.parametrize("make", [student, activity])
def test_masks_sum_to_one_and_expanding_changes_nothing(
    make: type, latents: tuple[Tensor, Tensor], x_bfmt: Tensor
) -> None:
    mixture = make(latents)
    torch.testing.assert_close(mixture.masks(x_bfmt).sum(-2), torch.ones(B, F, T, dtype=torch.float64))
    expanded = mixture.expand([4, B])
    assert type(expanded) is type(mixture)
    torch.testing.assert_close(expanded.log_prob(x_bfmt), mixture.log_prob(x_bfmt).expand(4, B))


def test_too_many_classes_for_patterns_are_refused(latents: tuple[Tensor, Tensor]) -> None:
    w_bkd, pi_bk = torch.ones(1, 11, D, dtype=torch.float64), torch.full((1, 11), 1 / 11, dtype=torch.float64)
    with pytest.raises(ValueError, match="11 source classes have too many patterns of activity; use at most 10"):
        activity((w_bkd, pi_bk))


def test_an_empty_class_takes_no_frame(x_bfmt: Tensor) -> None:
    """A sparse prior draws levels below 1e-30; whoever is so quiet must still have a likelihood of its own."""
    torch.manual_seed(0)
    w_bkd = torch.rand(B, K, D, dtype=torch.float64) + 0.01
    pi_bk = torch.tensor([[0.6, 0.4 - 1e-31, 1e-31]] * B, dtype=torch.float64)
    exact, single = (
        ActivityMixture(
            TEMPLATE_DFMM.to(template), w_bkd.to(real), pi_bk.to(real), num_frames=T, activity=0.3, most_active=1
        )
        for template, real in ((torch.complex128, torch.float64), (torch.complex64, torch.float32))
    )
    expected, found = exact.log_prob(x_bfmt), single.log_prob(x_bfmt.to(torch.complex64))
    torch.testing.assert_close(found.double(), expected, rtol=0, atol=0.01)

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from avssl_pyro.acoustics.covariance import (
    form_coefficients,
    inverse_and_logdet,
    outer_features,
    spatial_covariance,
    template_covariances,
)


def steering(f: int, d: int, m: int, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.exp(1j * 6 * torch.rand(f, d, m, dtype=torch.float64, generator=generator))


def hermitian(real: Tensor) -> Tensor:
    """Hermitian positive definite matrices from unconstrained real ones, (..., 2, M, M) to (..., M, M)."""
    factor = torch.complex(real[..., 0, :, :], real[..., 1, :, :])
    return factor @ factor.mH + 0.5 * torch.eye(real.shape[-1], dtype=factor.dtype)


def test_templates_are_outer_products() -> None:
    a_fdm = steering(2, 3, 4)
    template_dfmm = template_covariances(a_fdm)
    assert template_dfmm.shape == (3, 2, 4, 4)
    torch.testing.assert_close(template_dfmm[2, 1], torch.outer(a_fdm[1, 2], a_fdm[1, 2].conj()))


def test_scm_is_the_weighted_sum_of_templates_plus_diffuse_noise() -> None:
    template_dfmm = template_covariances(steering(2, 3, 4))
    w_bkd = torch.rand(5, 2, 3, dtype=torch.float64) + 0.1
    scm_bkfmm = spatial_covariance(w_bkd, template_dfmm, diffuse=0.2)
    assert scm_bkfmm.shape == (5, 2, 2, 4, 4)
    share = w_bkd / w_bkd.sum(-1, keepdim=True)
    expected = torch.einsum("bkd,dfmn->bkfmn", share.to(torch.complex128), template_dfmm)
    torch.testing.assert_close(scm_bkfmm, expected + 0.2 * torch.eye(4))


@given(st.integers(2, 6), st.integers(0, 2**31), st.floats(1e-12, 1e12))
@settings(max_examples=30)
def test_scm_is_hermitian_positive_definite_and_free_of_the_weights_scale(m: int, seed: int, scale: float) -> None:
    template_dfmm = template_covariances(steering(2, 5, m, seed))
    w_bkd = torch.exp(5 * torch.randn(1, 2, 5, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)))
    scm = spatial_covariance(w_bkd, template_dfmm, diffuse=0.01)
    torch.testing.assert_close(scm, scm.mH)
    assert torch.linalg.eigvalsh(scm).min() >= 0.01 * (1 - 1e-9)
    torch.testing.assert_close(spatial_covariance(scale * w_bkd, template_dfmm, diffuse=0.01), scm)


@given(st.integers(1, 7), st.integers(0, 2**31))
@settings(max_examples=30)
def test_features_and_coefficients_make_the_quadratic_form(m: int, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    x_bfmt = torch.randn(2, 3, m, 4, dtype=torch.complex128, generator=generator)
    p_bfmm = hermitian(torch.randn(2, 3, 2, m, m, dtype=torch.float64, generator=generator))
    features_bfct = outer_features(x_bfmt)
    assert features_bfct.shape == (2, 3, m * m, 4)
    quad_bft = (form_coefficients(p_bfmm)[..., None, :] @ features_bfct).squeeze(-2)
    expected = torch.einsum("bfmt,bfmn,bfnt->bft", x_bfmt.conj(), p_bfmm, x_bfmt)
    torch.testing.assert_close(quad_bft, expected.real)


def test_inverse_and_logdet_agree_with_torch_in_value_and_gradient() -> None:
    torch.manual_seed(0)
    real = torch.randn(2, 3, 2, 4, 4, dtype=torch.float64, requires_grad=True)
    weight = torch.randn(2, 3, 4, 4, dtype=torch.complex128)
    inverse, logdet = inverse_and_logdet(hermitian(real))
    expected_inverse = torch.linalg.inv(hermitian(real))
    expected_logdet = torch.linalg.slogdet(hermitian(real)).logabsdet
    torch.testing.assert_close(inverse, expected_inverse)
    torch.testing.assert_close(logdet, expected_logdet)
    (grad,) = torch.autograd.grad((weight * inverse).real.sum() + logdet.square().sum(), real)
    total = (weight * expected_inverse).real.sum() + expected_logdet.square().sum()
    (expected,) = torch.autograd.grad(total, real)
    torch.testing.assert_close(grad, expected)


def test_inverse_and_logdet_pass_gradcheck() -> None:
    torch.manual_seed(1)
    real = torch.randn(1, 2, 3, 3, dtype=torch.float64, requires_grad=True)

    def outputs(real: Tensor) -> tuple[Tensor, Tensor]:
        inverse, logdet = inverse_and_logdet(hermitian(real))
        return torch.view_as_real(inverse), logdet

    assert torch.autograd.gradcheck(outputs, (real,))

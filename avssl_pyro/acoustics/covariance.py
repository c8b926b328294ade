"""Spatial covariance matrices and their real-valued features.

A Hermitian M x M matrix has M^2 real degrees of freedom. In these features, sums of covariances and quadratic forms
are real matrix products, several times faster than complex triangular solves.
"""

import math
from typing import Any

import torch
from torch import Tensor


def template_covariances(steering_fdm: Tensor) -> Tensor:
    """Computes the rank-one templates G_fd = a_fd a_fd^H, complex (D, F, M, M); the paper's Sec. III-C."""
    outer_fdmm = steering_fdm[..., :, None] * steering_fdm[..., None, :].conj()
    return outer_fdmm.transpose(0, 1).contiguous()


def spatial_covariance(w_bkd: Tensor, template_dfmm: Tensor, diffuse: float) -> Tensor:
    """Computes the SCMs H_fk of Eq. (10), complex (B..., K, F, M, M): weighted templates plus diffuse noise.

    The power spectral density absorbs the scale of w, so w is first divided by its sum over directions. ``diffuse``,
    the factor of the identity matrix, is thus relative to the weights.
    """
    tiny = torch.finfo(w_bkd.dtype).tiny
    share_bkd = w_bkd / w_bkd.sum(-1, keepdim=True).clamp_min(tiny)
    d, f, m, _ = template_dfmm.shape
    template_real = torch.view_as_real(template_dfmm).reshape(d, f * m * m * 2)
    scm_real = (share_bkd @ template_real).reshape(*share_bkd.shape[:-1], f, m, m, 2)
    eye_mm = torch.eye(m, dtype=template_dfmm.dtype, device=template_dfmm.device)
    return torch.view_as_complex(scm_real) + diffuse * eye_mm


class _InverseAndLogDet(torch.autograd.Function):
    """Inverse and log determinant of Hermitian positive definite matrices from one Cholesky factor.

    Autograd would differentiate the factorisation; with P = H^-1 the gradient is P g P, two products.
    """

    @staticmethod
    def forward(ctx: Any, matrix: Tensor) -> tuple[Tensor, Tensor]:
        factor, _ = torch.linalg.cholesky_ex(matrix)
        inverse = torch.cholesky_inverse(factor)
        logdet = 2 * factor.diagonal(dim1=-2, dim2=-1).real.log().sum(-1)
        ctx.save_for_backward(inverse)
        return inverse, logdet

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *grads: Tensor) -> Tensor:
        grad_inverse, grad_logdet = grads
        (inverse,) = ctx.saved_tensors
        return grad_logdet[..., None, None] * inverse - inverse @ grad_inverse @ inverse


def inverse_and_logdet(matrix: Tensor) -> tuple[Tensor, Tensor]:
    """Computes P = H^-1 and log det H of Hermitian positive definite matrices (..., M, M); once differentiable."""
    inverse, logdet = _InverseAndLogDet.apply(matrix)
    return inverse, logdet


def outer_features(x_bfmt: Tensor) -> Tensor:
    """Computes the M^2 real features of x x^H, (..., F, M^2, T): powers, Re and Im of conj(x_m) x_n for m < n."""
    m = x_bfmt.shape[-2]
    # One contiguous plane per microphone and per feature: several times faster than indexing pairs of rows.
    real, imag = x_bfmt.real.movedim(-2, 0).contiguous(), x_bfmt.imag.movedim(-2, 0).contiguous()
    features = real.new_empty(m * m, *real.shape[1:])
    torch.mul(real, real, out=features[:m]).addcmul_(imag, imag)
    start, pairs = m, m * (m - 1) // 2
    for first in range(m - 1):
        stop = start + m - 1 - first
        torch.mul(real[first], real[first + 1 :], out=features[start:stop]).addcmul_(imag[first], imag[first + 1 :])
        cross_imag = torch.mul(real[first], imag[first + 1 :], out=features[start + pairs : stop + pairs])
        cross_imag.addcmul_(imag[first], real[first + 1 :], value=-1)
        start = stop
    return features.movedim(0, -2)


def form_coefficients(matrix: Tensor) -> Tensor:
    """Returns the coefficients of x^H P x in the features of :func:`outer_features`, (..., M^2)."""
    m = matrix.shape[-1]
    row, column = torch.triu_indices(m, m, offset=1, device=matrix.device)
    upper = 2 * matrix[..., row, column]
    return torch.cat([matrix.diagonal(dim1=-2, dim2=-1).real, upper.real, -upper.imag], dim=-1)


def matrix_from_features(feature: Tensor) -> Tensor:
    """Returns the Hermitian matrices, complex (..., M, M), of real features (..., M^2)."""
    m = math.isqrt(feature.shape[-1])
    row, column = torch.triu_indices(m, m, offset=1, device=feature.device)
    pairs = row.numel()
    power, real, imag = feature.split([m, pairs, pairs], dim=-1)
    # The features hold conj(x_m) x_n for m < n, which is entry (n, m) of x x^H.
    lower = torch.complex(real, imag)
    matrix = lower.new_zeros(*feature.shape[:-1], m, m)
    matrix[..., column, row] = lower
    matrix[..., row, column] = lower.conj()
    matrix.diagonal(dim1=-2, dim2=-1).copy_(power)
    return matrix


def template_features(template_dfmm: Tensor) -> Tensor:
    """Computes real features of the templates G_fd, (D, F, M^2), in which a^H Q a is a real product."""
    m = template_dfmm.shape[-1]
    row, column = torch.triu_indices(m, m, offset=1, device=template_dfmm.device)
    lower = template_dfmm[..., column, row]
    return torch.cat([template_dfmm.diagonal(dim1=-2, dim2=-1).real, lower.real, lower.imag], dim=-1)

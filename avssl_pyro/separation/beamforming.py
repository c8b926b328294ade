"""Mask-based beamforming: extraction of one source from a spectrogram.

An extraction is an object called as ``extraction(x_fmt, mask_ft, reference)``. It estimates the image of the source at
the reference microphone, on the scale of the mixture.
"""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor


class Extraction(Protocol):
    """Extraction of one source by its mask."""

    def __call__(self, x_fmt: Tensor, mask_ft: Tensor, reference: int) -> Tensor:
        """Estimates the source at the reference microphone, complex (F, T).

        Args:
            x_fmt: spectrogram, complex (F, M, T).
            mask_ft: posterior probability that the source dominates a bin, (F, T).
            reference: number of the microphone, counted from 0.
        """
        ...


@dataclass(frozen=True)
class WienerFilter:
    """Multichannel Wiener filter h = Phi_x^-1 Phi_s u (Doclo and Moonen 2002).

    The filter minimizes the mean squared error at each frequency; it distorts the source to suppress the others. The
    covariance of the source may have any rank, so early reflections belong to the source.

    Args:
        loading: diagonal loading of the inverted matrix, relative to its mean power.
    """

    loading: float = 1e-3

    def __call__(self, x_fmt: Tensor, mask_ft: Tensor, reference: int) -> Tensor:
        total_fmm = mask_covariance(x_fmt, torch.ones_like(mask_ft))
        source_fm1 = mask_covariance(x_fmt, mask_ft)[..., reference, None]
        inverted_fmm = _loaded(total_fmm, self.loading * _mean_power(total_fmm))
        return _filtered(torch.linalg.solve(inverted_fmm, source_fm1).squeeze(-1), x_fmt)


@dataclass(frozen=True)
class Mvdr:
    """Minimum variance distortionless response, h = Phi_n^-1 Phi_s u / tr(Phi_n^-1 Phi_s).

    Souden, Benesty and Affes 2010, Eq. (24). The filter needs no steering vector. A source of rank one passes
    undistorted.

    Args:
        loading: diagonal loading of Phi_n, relative to the mean power of the mixture.
    """

    loading: float = 1e-3

    def __call__(self, x_fmt: Tensor, mask_ft: Tensor, reference: int) -> Tensor:
        source_fmm, noise_fmm = mask_covariance(x_fmt, mask_ft), mask_covariance(x_fmt, 1 - mask_ft)
        inverted_fmm = _loaded(noise_fmm, self.loading * _mean_power(source_fmm + noise_fmm))
        ratio_fmm = torch.linalg.solve(inverted_fmm, source_fmm)
        trace_f1 = ratio_fmm.diagonal(dim1=-2, dim2=-1).real.sum(-1, keepdim=True)
        return _filtered(ratio_fmm[..., reference] / trace_f1.clamp_min(torch.finfo(trace_f1.dtype).tiny), x_fmt)


@dataclass(frozen=True)
class Masking:
    """Multiplication of the mask with the signal of the reference microphone."""

    def __call__(self, x_fmt: Tensor, mask_ft: Tensor, reference: int) -> Tensor:
        return mask_ft * x_fmt[:, reference]


def delay_and_sum(x_fmt: Tensor, steering_fm: Tensor, reference: int) -> Tensor:
    """Aligns the microphones to the reference for a plane wave and averages them, complex (F, T)."""
    aligned_fm = steering_fm * steering_fm[:, reference, None].conj()
    return _filtered(aligned_fm / steering_fm.abs().square().sum(-1, keepdim=True), x_fmt)


def mask_covariance(x_fmt: Tensor, mask_ft: Tensor) -> Tensor:
    """Computes sum_t mask x x^H, complex (F, M, M)."""
    return (mask_ft[:, None] * x_fmt) @ x_fmt.mH


def _filtered(filter_fm: Tensor, x_fmt: Tensor) -> Tensor:
    return (filter_fm.conj()[:, None] @ x_fmt).squeeze(-2)


def _mean_power(scm_fmm: Tensor) -> Tensor:
    return scm_fmm.diagonal(dim1=-2, dim2=-1).real.mean(-1)


def _loaded(scm_fmm: Tensor, power_f: Tensor) -> Tensor:
    # The loading of silence would be zero; the smallest number makes its matrix regular and its output zero.
    power_f = power_f.clamp_min(torch.finfo(power_f.dtype).tiny)
    return scm_fmm + power_f[:, None, None] * torch.eye(scm_fmm.shape[-1], dtype=scm_fmm.dtype, device=scm_fmm.device)

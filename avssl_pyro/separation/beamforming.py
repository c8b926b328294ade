"""From a mask to the sound of one source: filters over the microphones, and the mask itself.

Every way is an object called as ``extraction(x_fmt, mask_ft, reference)``. Its answer estimates the source as the
reference microphone hears it, so levels of sources and of the mixture can be compared.
"""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor


class Extraction(Protocol):
    """Takes one source out of a spectrogram by its mask."""

    def __call__(self, x_fmt: Tensor, mask_ft: Tensor, reference: int) -> Tensor:
        """The source at one microphone, complex (F, T).

        Args:
            x_fmt: spectrogram, complex (F, M, T).
            mask_ft: probability that the source dominates a bin, (F, T).
            reference: microphone, counted from 0.
        """
        ...


@dataclass(frozen=True)
class WienerFilter:
    """Multichannel Wiener filter h = Phi_x^-1 Phi_s u, the least mean squared error of one filter per frequency.

    Doclo and Moonen 2002. It trades some of the source for less of the others, and needs no source of rank one: in a
    room the early reflections belong to it.

    Args:
        loading: share of the mean power that is added to the diagonal of the matrix that is inverted.
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

    Souden, Benesty and Affes 2010, Eq. (24): no steering vector is needed, and a source of rank one passes as the
    reference microphone hears it.

    Args:
        loading: share of the mixture's mean power that is added to the diagonal of Phi_n.
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
    """The mask times what the reference microphone heard."""

    def __call__(self, x_fmt: Tensor, mask_ft: Tensor, reference: int) -> Tensor:
        return mask_ft * x_fmt[:, reference]


def delay_and_sum(x_fmt: Tensor, steering_fm: Tensor, reference: int) -> Tensor:
    """Microphones aligned to one of them for a plane wave with this steering vector, and averaged, complex (F, T)."""
    aligned_fm = steering_fm * steering_fm[:, reference, None].conj()
    return _filtered(aligned_fm / steering_fm.abs().square().sum(-1, keepdim=True), x_fmt)


def mask_covariance(x_fmt: Tensor, mask_ft: Tensor) -> Tensor:
    """sum_t mask x x^H, complex (F, M, M)."""
    return (mask_ft[:, None] * x_fmt) @ x_fmt.mH


def _filtered(filter_fm: Tensor, x_fmt: Tensor) -> Tensor:
    return (filter_fm.conj()[:, None] @ x_fmt).squeeze(-2)


def _mean_power(scm_fmm: Tensor) -> Tensor:
    return scm_fmm.diagonal(dim1=-2, dim2=-1).real.mean(-1)


def _loaded(scm_fmm: Tensor, power_f: Tensor) -> Tensor:
    # Silence has no power to load with; the smallest number makes its matrix regular, and its answer zero.
    power_f = power_f.clamp_min(torch.finfo(power_f.dtype).tiny)
    return scm_fmm + power_f[:, None, None] * torch.eye(scm_fmm.shape[-1], dtype=scm_fmm.dtype, device=scm_fmm.device)

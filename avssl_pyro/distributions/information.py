"""What a spectrogram tells of direction weights and mixing levels: Fisher information of the spatial mixture.

A class with its power spectral density profiled out is a complex angular central Gaussian with matrix H. Moving H by A,
and P = H^-1, the information of one bin is M / (M + 1) (tr(P A P A) - tr(P A)^2 / M): a change of scale tells nothing.
Log-weight d moves H by w_d (a_d a_d^H + eps I). Under the bound of :mod:`avssl_pyro.distributions.ascent` a direction
counts by the share q = w_d a_d^H P a_d that it has in H; here it counts by q^2, so that one among many that could take
its part is known as badly as it should be.

Masks are not observed. Of what a bin that is class k with probability gamma would tell of that class if it were known
to be, gamma^2 remains of gamma, for directions; for levels the mean over classes of (gamma - pi)^2 / pi.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from avssl_pyro.acoustics.covariance import form_coefficients, inverse_and_logdet, spatial_covariance, template_features
from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram, quadratic_form


@dataclass(frozen=True)
class MixtureInformation:
    """Of a batch of clips.

    Args:
        log_weights_bkd: information on every log-weight, all else known, (B, K, D).
        levels_b: what of the information on levels is left when masks are not observed, 0 to 1, (B,).
    """

    log_weights_bkd: Tensor
    levels_b: Tensor


@torch.no_grad()
def mixture_information(
    observed: ObservedSpectrogram, template_dfmm: Tensor, diffuse: float, log_w_bkd: Tensor, pi_bk: Tensor
) -> MixtureInformation:
    """Information at a point; arguments as of :class:`avssl_pyro.distributions.ascent.MixtureAscent`."""
    m = observed.num_microphones
    share_bkd = log_w_bkd.softmax(-1)
    inverse_bkfmm, logdet_bkf = inverse_and_logdet(spatial_covariance(share_bkd, template_dfmm, diffuse))
    floor = m * observed.floor_b[..., None, None, None]
    quad_bfkt = quadratic_form(observed, inverse_bkfmm).clamp_min(0) + floor
    log_pi_bk = pi_bk.clamp_min(torch.finfo(pi_bk.dtype).tiny).log()
    bias_bfk = (log_pi_bk[..., None] - logdet_bkf).transpose(-2, -1)
    gamma_bfkt = (bias_bfk[..., None] - m * quad_bfkt.log()).softmax(dim=-2)

    # a^H P a and a^H P^2 a, with the traces that belong to eps I.
    features_dfc = template_features(template_dfmm)
    square_bkfmm = inverse_bkfmm @ inverse_bkfmm
    first_bkfd, second_bkfd = (
        torch.einsum("...kfc,dfc->...kfd", form_coefficients(matrix), features_dfc)
        for matrix in (inverse_bkfmm, square_bkfmm)
    )
    trace_bkf1, square_trace_bkf1 = (
        matrix.diagonal(dim1=-2, dim2=-1).real.sum(-1, keepdim=True) for matrix in (inverse_bkfmm, square_bkfmm)
    )
    single_bkfd = first_bkfd + diffuse * trace_bkf1
    double_bkfd = first_bkfd.square() + 2 * diffuse * second_bkfd + diffuse**2 * square_trace_bkf1
    of_bin_bkfd = (m / (m + 1) * (double_bkfd - single_bkfd.square() / m)).clamp_min(0)
    known_bkf = gamma_bfkt.square().sum(-1).transpose(-2, -1)
    log_weights_bkd = share_bkd.square() * (known_bkf[..., None] * of_bin_bkfd).sum(-2)

    told_b = (gamma_bfkt.square().mean((-3, -1)) / pi_bk.clamp_min(torch.finfo(pi_bk.dtype).tiny)).sum(-1) - 1
    levels_b = (told_b / max(pi_bk.shape[-1] - 1, 1)).clamp(0, 1)
    return MixtureInformation(log_weights_bkd, levels_b)

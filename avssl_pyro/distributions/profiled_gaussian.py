"""The zero-mean complex Gaussian of one source with its power spectral density profiled out (Eqs. 8, 15, 16).

Pure functions over whole batches of clips and sources, shared by the mixture distribution, the refinement of
posteriors and the masks.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from avssl_pyro.acoustics.covariance import form_coefficients, inverse_and_logdet, outer_features

# Added to every power spectral density, as a share of the clip's mean power: a bin of digital silence would have
# lambda = 0 and an infinite likelihood under every source, without information on directions. -100 dB is below the
# quantisation noise of a 16-bit recording.
RELATIVE_POWER_FLOOR = 1e-10
# The floor of a clip that is silent throughout, relative to a largest magnitude of 1.
ABSOLUTE_POWER_FLOOR = 1e-30


@dataclass(frozen=True)
class ObservedSpectrogram:
    """Sufficient statistics of x, computed once for all evaluations of the likelihood.

    Args:
        features_bfct: real features of x x^H with x scaled to a largest magnitude of 1, (B..., F, M^2, T).
        log_scale_b: logarithm of the scale taken out, (B...).
        floor_b: power floor of the scaled x, (B...).
        num_microphones: number of microphones M.
    """

    features_bfct: Tensor
    log_scale_b: Tensor
    floor_b: Tensor
    num_microphones: int


def observe(x_bfmt: Tensor) -> ObservedSpectrogram:
    """Sufficient statistics of a complex spectrogram (B..., F, M, T).

    Scaling by the largest magnitude first keeps squares within float32 for any finite input.
    """
    parts = torch.view_as_real(x_bfmt)
    smallest, largest = parts.flatten(-4).aminmax(dim=-1)
    scale_b = torch.maximum(largest, -smallest).clamp_min(torch.finfo(parts.dtype).tiny)
    scaled = torch.view_as_complex(parts / scale_b[..., None, None, None, None])
    features_bfct = outer_features(scaled)
    num_microphones = x_bfmt.shape[-2]
    mean_power_b = features_bfct[..., :num_microphones, :].mean(dim=(-3, -2, -1))
    floor_b = (RELATIVE_POWER_FLOOR * mean_power_b).clamp_min(ABSOLUTE_POWER_FLOOR)
    return ObservedSpectrogram(features_bfct, scale_b.log(), floor_b, num_microphones)


def quadratic_form(observed: ObservedSpectrogram, inverse_bkfmm: Tensor) -> Tensor:
    """x^H P x for every bin and source, (B..., F, K, T), by one real matrix product over the M^2 features."""
    coefficients_bfkc = form_coefficients(inverse_bkfmm).transpose(-3, -2)
    features_bfct = observed.features_bfct
    # x may have more leading dimensions than H (many recordings, one model); they broadcast as they are.
    particles = coefficients_bfkc.shape[: max(0, coefficients_bfkc.dim() - features_bfct.dim())]
    if particles:
        # Broadcasting the large features over particles would copy them; stack particles among the sources instead.
        p, (*b, f, k, c) = math.prod(particles), coefficients_bfkc.shape[len(particles) :]
        stacked = coefficients_bfkc.reshape(p, *b, f, k, c).movedim(0, -3).reshape(*b, f, p * k, c)
        quad = (stacked @ features_bfct).unflatten(-2, (p, k)).movedim(-3, 0)
        return quad.reshape(*particles, *quad.shape[1:])
    return coefficients_bfkc @ features_bfct


def isotropic_log_likelihood(observed: ObservedSpectrogram) -> Tensor:
    """log p(x) with H = I in every bin, (B...): the reference without directions."""
    m = observed.num_microphones
    power_bft = observed.features_bfct[..., :m, :].sum(-2) + m * observed.floor_b[..., None, None]
    bias_b = 2 * m * observed.log_scale_b + m * (1 + math.log(math.pi / m))
    return (-m * power_bft.log() - bias_b[..., None, None]).sum((-2, -1))


def component_log_likelihood(observed: ObservedSpectrogram, scm_bkfmm: Tensor) -> Tensor:
    """log N_C(x_tf; 0, lambda_tfk H_fk) with lambda_tfk = x^H H^-1 x / M of Eq. (16), (B..., F, K, T).

    With this lambda the exponent of Eq. (15) is the constant -M. The power floor is added to lambda, which changes
    nothing in bins above it and bounds the likelihood of silent ones.
    """
    inverse_bkfmm, logdet_bkf = inverse_and_logdet(scm_bkfmm)
    m = observed.num_microphones
    quad_bfkt = quadratic_form(observed, inverse_bkfmm)
    floor = observed.floor_b[..., None, None, None]
    # lambda = (quad + M floor) / M; the division is taken out of the logarithm to save a pass over the largest tensor.
    bias_bfk = (
        logdet_bkf.transpose(-2, -1) + 2 * m * observed.log_scale_b[..., None, None] + m * (1 + math.log(math.pi / m))
    )
    return -m * (quad_bfkt.clamp_min(0) + m * floor).log() - bias_bfk[..., None]

"""Time-frequency masks of the sources of one clip, from the posterior of their directions and levels.

The covariances of the posterior are sums over directions and leave out the effect of the room on a source. Its masks
therefore initialize a mixture with free covariances: guided source separation (Boeddeker et al. 2018).
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from avssl_pyro.acoustics.covariance import inverse_and_logdet, matrix_from_features
from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram, quadratic_form
from avssl_pyro.distributions.spatial_mixture import SpatialMixture
from avssl_pyro.errors import InputError
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource

# Diagonal loading of free covariances relative to the mean eigenvalue; few bins give no matrix of full rank.
LOADING = 1e-4


def posterior_masks(
    observed: ObservedSpectrogram, template_dfmm: Tensor, posterior: ClipPosterior, diffuse: float
) -> Tensor:
    """Computes p(z_tf = k | x, w, pi), (F, K, T), at the posterior means of w and pi; sums to 1 over k.

    Args:
        observed: spectrogram of any band.
        template_dfmm: templates of that band, complex128 (D, F, M, M), or (D + C, F, M, M) with a room.
        posterior: posterior of the clip; without diffuse shares, templates of directions alone are used.
        diffuse: diffuse power eps of the model.

    Raises:
        InputError: the posterior has diffuse shares of other components than the templates.
    """
    num_directions = posterior.direction_weights_kd.shape[-1]
    tiny = torch.finfo(torch.float64).tiny
    w_kd = torch.from_numpy(posterior.direction_weights_kd)
    if posterior.diffuse_shares_kc is not None:
        diffuse_kc = torch.from_numpy(posterior.diffuse_shares_kc)
        found, expected = diffuse_kc.shape[-1], len(template_dfmm) - num_directions
        if found != expected:
            raise InputError(
                f"separation: the posterior has {found} diffuse components and the room of the system {expected}; "
                "separate with the configuration of the model that localized."
            )
        w_kd = torch.cat([w_kd * (1 - diffuse_kc.sum(-1, keepdim=True)), diffuse_kc], dim=-1)
    template_dfmm = template_dfmm[: w_kd.shape[-1]]
    w_kd = w_kd.to(template_dfmm.device).clamp_min(tiny)
    pi_k = torch.from_numpy(posterior.mixing_levels_k).to(template_dfmm.device)
    num_frames = observed.features_bfct.shape[-1]
    return SpatialMixture(template_dfmm, w_kd, pi_k / pi_k.sum(), num_frames=num_frames, diffuse=diffuse).masks(
        observed
    )


def masks_of_sources(gamma_fkt: Tensor, sources: Sequence[LocalizedSource], reverberation: float) -> Tensor:
    """Computes masks of S sources and, last, of everything else, (F, S + 1, T); they sum to 1.

    Args:
        gamma_fkt: masks of the source classes, (F, K, T).
        sources: sources; the mask of a source is the sum of the masks of its classes.
        reverberation: share of everything else (diffuse noise and classes that are no source) that is divided among the
            sources in proportion to their masks. Most of it is reverberation of the sources.
    """
    mask_fst = torch.stack([gamma_fkt[:, list(source.classes)].sum(1) for source in sources], dim=1)
    active_f1t = mask_fst.sum(1, keepdim=True)
    tiny = torch.finfo(mask_fst.dtype).tiny
    mask_fst = mask_fst * (1 + reverberation * (1 - active_f1t) / active_f1t.clamp_min(tiny))
    return torch.cat([mask_fst, (1 - mask_fst.sum(1, keepdim=True)).clamp_min(0)], dim=1)


def fitted_masks(observed: ObservedSpectrogram, mask_fst: Tensor, rounds: int) -> Tensor:
    """Fits a mixture of complex angular central Gaussians by EM and returns its masks, (F, S, T).

    Every class has a free covariance per frequency (Ito, Araki and Nakatani 2016) and a level per frame, equal at all
    frequencies (Ito, Araki and Nakatani 2013). The common level prevents permutations of sources between frequencies.

    Args:
        observed: spectrogram.
        mask_fst: initial masks, (F, S, T), which sum to 1 over sources.
        rounds: number of EM iterations.
    """
    m = observed.num_microphones
    features_fct = observed.features_bfct
    floor = m * observed.floor_b
    tiny = torch.finfo(mask_fst.dtype).tiny
    eye_mm = torch.eye(m, dtype=mask_fst.dtype, device=mask_fst.device)
    # With equal covariances the quadratic form is the power.
    quad_fst = (features_fct[:, :m].sum(1, keepdim=True) + floor).expand_as(mask_fst)
    for _ in range(rounds):
        level_1st = mask_fst.mean(0, keepdim=True).clamp_min(tiny)
        scm_fsmm = matrix_from_features((mask_fst / quad_fst) @ features_fct.mT)
        # The likelihood does not depend on the scale of a covariance.
        power_fs11 = scm_fsmm.diagonal(dim1=-2, dim2=-1).real.mean(-1)[..., None, None]
        inverse_fsmm, logdet_fs = inverse_and_logdet(scm_fsmm / power_fs11.clamp_min(tiny) + LOADING * eye_mm)
        quad_fst = quadratic_form(observed, inverse_fsmm.transpose(0, 1)).clamp_min(0) + floor
        mask_fst = (level_1st.log() - m * quad_fst.log() - logdet_fs[..., None]).softmax(dim=1)
    return mask_fst

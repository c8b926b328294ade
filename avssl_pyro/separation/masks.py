"""Time-frequency masks of the sources of one clip, from the posterior of their directions and levels.

The posterior's covariances are sums over directions, which say nothing of what a room makes of a source. Its masks are
therefore only where a fit starts whose covariances are free: guided source separation (Boeddeker et al. 2018).
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from avssl_pyro.acoustics.covariance import inverse_and_logdet, matrix_from_features
from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram, quadratic_form
from avssl_pyro.distributions.spatial_mixture import SpatialMixture
from avssl_pyro.localization.posterior import ClipPosterior, LocalizedSource

# Of the mean eigenvalue, added to free covariances: a class of few bins has none of full rank.
LOADING = 1e-4


def posterior_masks(
    observed: ObservedSpectrogram, template_dfmm: Tensor, posterior: ClipPosterior, diffuse: float
) -> Tensor:
    """p(z_tf = k | x, w, pi) by enumeration, at the posterior means of w and pi, (F, K, T), summing to 1 over k.

    Args:
        observed: the spectrogram, of any band.
        template_dfmm: templates of that band, complex128 (D, F, M, M).
        posterior: of the clip.
        diffuse: eps of the model.
    """
    tiny = torch.finfo(torch.float64).tiny
    w_kd = torch.from_numpy(posterior.direction_weights_kd).to(template_dfmm.device).clamp_min(tiny)
    pi_k = torch.from_numpy(posterior.mixing_levels_k).to(template_dfmm.device)
    num_frames = observed.features_bfct.shape[-1]
    return SpatialMixture(template_dfmm, w_kd, pi_k / pi_k.sum(), num_frames=num_frames, diffuse=diffuse).masks(
        observed
    )


def masks_of_sources(gamma_fkt: Tensor, sources: Sequence[LocalizedSource], reverberation: float) -> Tensor:
    """Masks of S sources, and of everything else in the last place, (F, S + 1, T), summing to 1.

    Args:
        gamma_fkt: masks of the source classes, (F, K, T).
        sources: the mask of each is the sum of those of its classes.
        reverberation: share of everything else, the classes of diffuse noise and those too quiet for a source, that is
            divided among the sources in proportion to their own masks. Most of it are reflections of their sound.
    """
    mask_fst = torch.stack([gamma_fkt[:, list(source.classes)].sum(1) for source in sources], dim=1)
    heard_f1t = mask_fst.sum(1, keepdim=True)
    tiny = torch.finfo(mask_fst.dtype).tiny
    mask_fst = mask_fst * (1 + reverberation * (1 - heard_f1t) / heard_f1t.clamp_min(tiny))
    return torch.cat([mask_fst, (1 - mask_fst.sum(1, keepdim=True)).clamp_min(0)], dim=1)


def fitted_masks(observed: ObservedSpectrogram, mask_fst: Tensor, rounds: int) -> Tensor:
    """The masks of a mixture of complex angular central Gaussians after rounds of EM that start at ``mask_fst``.

    Every class has a free covariance per frequency (Ito, Araki and Nakatani 2016) and a level per frame, the same at
    all frequencies (Ito, Araki and Nakatani 2013): frequencies thus agree on who speaks when, and none can swap two
    sources that all the others keep apart.

    Args:
        observed: the spectrogram.
        mask_fst: masks to start at, (F, S, T), summing to 1.
        rounds: of EM.
    """
    m = observed.num_microphones
    features_fct = observed.features_bfct
    floor = m * observed.floor_b
    tiny = torch.finfo(mask_fst.dtype).tiny
    eye_mm = torch.eye(m, dtype=mask_fst.dtype, device=mask_fst.device)
    # With all covariances alike the quadratic form is the power.
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

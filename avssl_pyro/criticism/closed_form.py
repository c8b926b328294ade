"""The ELBO in closed form, Eqs. (15)-(19): the reference for Pyro's estimators.

It follows the equations with plain complex algebra and shares no code with the distributions or the training.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from avssl_pyro.distributions.profiled_gaussian import RELATIVE_POWER_FLOOR
from avssl_pyro.guides.amortized import AmortizedGuide
from avssl_pyro.models.room import Room

# Frames this far below the loudest do not decide on the scale of the weights of bins.
LOUD_DB = 30.0


@dataclass(frozen=True)
class ClosedFormTerms:
    """The terms of the ELBO, Eqs. (14)-(19), per clip, (B,) each; the last is None without a room."""

    log_likelihood_b: Tensor
    kl_weights_b: Tensor
    kl_levels_b: Tensor
    kl_diffuse_b: Tensor | None = None

    @property
    def loss(self) -> Tensor:
        """The negative ELBO summed over clips, ()."""
        loss_b = self.kl_weights_b + self.kl_levels_b - self.log_likelihood_b
        return (loss_b if self.kl_diffuse_b is None else loss_b + self.kl_diffuse_b).sum()


def log_likelihood(x_bfmt: Tensor, steering_fdm: Tensor, w_bkd: Tensor, pi_bk: Tensor, diffuse: float) -> Tensor:
    """log p(x | w, pi) of Eq. (15) with lambda of Eq. (16), (B,)."""
    share_bkd = (w_bkd / w_bkd.sum(-1, keepdim=True)).to(steering_fdm.dtype)
    scm_bkfmn = torch.einsum("bkd,fdm,fdn->bkfmn", share_bkd, steering_fdm, steering_fdm.conj())
    return _log_density(x_bfmt, scm_bkfmn, pi_bk, diffuse).sum((-2, -1))


def room_log_likelihood(
    x_bfmt: Tensor,
    direction_dfmm: Tensor,
    diffuse_cfmm: Tensor,
    w_bkd: Tensor,
    e_bkc: Tensor,
    pi_bk: Tensor,
    diffuse: float,
    bin_weight_bft: Tensor | None = None,
) -> Tensor:
    """log p(x | w, e, pi) of a model with a room, (B,).

    Args:
        x_bfmt: spectrograms.
        direction_dfmm, diffuse_cfmm: templates of directions and of diffuse components.
        w_bkd, e_bkc, pi_bk: their weights, and the mixing levels.
        diffuse: eps relative to all weights of a class together.
        bin_weight_bft: weights of the bins; None for 1.
    """
    total_bk1 = w_bkd.sum(-1, keepdim=True) + e_bkc.sum(-1, keepdim=True)
    dtype = direction_dfmm.dtype
    scm_bkfmn = torch.einsum("bkd,dfmn->bkfmn", (w_bkd / total_bk1).to(dtype), direction_dfmm)
    scm_bkfmn = scm_bkfmn + torch.einsum("bkc,cfmn->bkfmn", (e_bkc / total_bk1).to(dtype), diffuse_cfmm)
    log_density_bft = _log_density(x_bfmt, scm_bkfmn, pi_bk, diffuse)
    weighted_bft = log_density_bft if bin_weight_bft is None else bin_weight_bft * log_density_bft
    return weighted_bft.sum((-2, -1))


def onset_weights(x_bfmt: Tensor, log_decay: float, least: float) -> Tensor:
    """Weights c_tf of :mod:`avssl_pyro.distributions.precedence`, (B, F, T), by their recursion over frames."""
    m = x_bfmt.shape[-2]
    square_bfmt = x_bfmt.abs().square()
    raw_bft = square_bfmt.sum(-2) + m * RELATIVE_POWER_FLOOR * square_bfmt.mean((1, 2, 3))[:, None, None]
    around_bft = torch.cat([raw_bft[:, :1], raw_bft, raw_bft[:, -1:]], dim=1)
    power_bft = (around_bft[:, :-2] + around_bft[:, 1:-1] + around_bft[:, 2:]) / 3
    reverberation_bf, weights = torch.zeros_like(power_bft[..., 0]), []
    for t in range(power_bft.shape[-1]):
        power_bf = power_bft[..., t]
        weights.append((1 - reverberation_bf / power_bf).clamp_min(least))
        reverberation_bf = math.exp(log_decay) * torch.maximum(reverberation_bf, power_bf)
    weight_bft, frame_bt = torch.stack(weights, dim=-1), raw_bft.mean(1)
    loud_bt = frame_bt >= frame_bt.amax(-1, keepdim=True) * 10 ** (-LOUD_DB / 10)
    mean_b = torch.stack([weight_ft[:, loud_t].mean() for weight_ft, loud_t in zip(weight_bft, loud_bt, strict=True)])
    return weight_bft / mean_b[:, None, None]


def _log_density(x_bfmt: Tensor, scm_bkfmn: Tensor, pi_bk: Tensor, diffuse: float) -> Tensor:
    """log p(x_tf) with eps still to be added to the covariances, (B, F, T)."""
    m = x_bfmt.shape[-2]
    scm_bkfmn = scm_bkfmn + diffuse * torch.eye(m, dtype=scm_bkfmn.dtype)
    solved_bkfmt = torch.linalg.solve(scm_bkfmn, x_bfmt[:, None])
    quad_bkft = (x_bfmt[:, None].conj() * solved_bkfmt).sum(-2).real
    floor_b = RELATIVE_POWER_FLOOR * x_bfmt.abs().square().mean((1, 2, 3))
    psd_bkft = quad_bkft / m + floor_b[:, None, None, None]
    logdet_bkf = torch.linalg.slogdet(scm_bkfmn).logabsdet
    log_gauss_bkft = -m * torch.log(math.pi * psd_bkft) - logdet_bkf[..., None] - m
    return torch.logsumexp(pi_bk.log()[..., None, None] + log_gauss_bkft, dim=1)


def kl_log_normal(mu_bkd: Tensor, sigma_k: Tensor, prior_sigma: float) -> Tensor:
    """KL(q(w) || p(w)) of Eq. (18), (B,)."""
    variance_k1 = sigma_k[:, None] ** 2
    quadratic = (mu_bkd**2 + variance_k1 - prior_sigma**2) / (2 * prior_sigma**2)
    return (quadratic + torch.log(prior_sigma / sigma_k[:, None])).sum((-2, -1))


def kl_diffuse_weights(mu_bkc: Tensor, sigma_kc: Tensor, prior_mean: float, prior_sigma: float) -> Tensor:
    """KL(q(e) || p(e)) of log-normal diffuse weights, (B,)."""
    quadratic = ((mu_bkc - prior_mean) ** 2 + sigma_kc**2 - prior_sigma**2) / (2 * prior_sigma**2)
    return (quadratic + torch.log(prior_sigma / sigma_kc)).sum((-2, -1))


def kl_dirichlet(concentration_bk: Tensor, prior_alpha: float) -> Tensor:
    """KL(Dir(beta pi_bar) || Dir(alpha_0)) of Eq. (19), (B,)."""
    k = concentration_bk.shape[-1]
    total_b = concentration_bk.sum(-1)
    log_norm = torch.lgamma(total_b) - math.lgamma(k * prior_alpha)
    log_gamma = (torch.lgamma(concentration_bk) - math.lgamma(prior_alpha)).sum(-1)
    expected_log_pi = torch.digamma(concentration_bk) - torch.digamma(total_b)[..., None]
    return log_norm - log_gamma + ((concentration_bk - prior_alpha) * expected_log_pi).sum(-1)


def closed_form_terms(
    guide: AmortizedGuide,
    steering_fdm: Tensor,
    x_bfmt: Tensor,
    image_bcij: Tensor,
    *,
    prior_alpha: float,
    prior_sigma: float,
    diffuse: float,
    room: Room | None = None,
    bin_weight_bft: Tensor | None = None,
) -> ClosedFormTerms:
    """One Monte Carlo evaluation of the ELBO by hand.

    Draws w, then pi, then e with a room, from torch's global generator as Pyro does, so that at one seed both see the
    same noise.

    Args:
        guide: guide with an audio network.
        steering_fdm: steering vectors, complex (F, D, M); with a room its templates take their place.
        x_bfmt, image_bcij: spectrograms and images of the clips.
        prior_alpha, prior_sigma: of the Dirichlet prior of levels and of the log-normal prior of direction weights.
        diffuse: eps relative to all weights of a class together.
        room: templates, and prior of the diffuse weights.
        bin_weight_bft: weights of the bins of a model with a room; None for 1.
    """
    mu_bkd, _ = guide.log_weights(image_bcij)
    sigma_k = guide.log_sigma_k.exp()
    feature_bcdt = guide.audio.direction_features(x_bfmt)
    w_bkd = torch.exp(mu_bkd + sigma_k[:, None] * torch.randn_like(mu_bkd))
    source_bkc = guide.source_features(feature_bcdt, w_bkd)
    concentration_bk = guide.concentration(source_bkc)
    pi_bk = torch.distributions.Dirichlet(concentration_bk).rsample()
    kl_weights_b = kl_log_normal(mu_bkd, sigma_k, prior_sigma)
    kl_levels_b = kl_dirichlet(concentration_bk, prior_alpha)
    if room is None:
        likelihood_b = log_likelihood(x_bfmt, steering_fdm, w_bkd, pi_bk, diffuse)
        return ClosedFormTerms(likelihood_b, kl_weights_b, kl_levels_b)
    diffuse_sigma_kc = guide.diffuse_log_sigma_kc.exp()
    diffuse_mu_bkc = w_bkd.sum(-1, keepdim=True).log() + guide.log_diffuse_ratios(source_bkc)
    e_bkc = torch.exp(diffuse_mu_bkc + diffuse_sigma_kc * torch.randn_like(diffuse_mu_bkc))
    return ClosedFormTerms(
        room_log_likelihood(
            x_bfmt, room.direction_dfmm, room.diffuse_cfmm, w_bkd, e_bkc, pi_bk, diffuse, bin_weight_bft
        ),
        kl_weights_b,
        kl_levels_b,
        kl_diffuse_weights(diffuse_mu_bkc, diffuse_sigma_kc, room.mean, room.sigma),
    )

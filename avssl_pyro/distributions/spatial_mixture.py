"""The paper's spatial mixture (cGMM) of a multichannel spectrogram, marginalised over time-frequency masks."""

from typing import Any, ClassVar

import torch
from pyro.distributions import TorchDistribution
from torch import Size, Tensor
from torch.distributions import constraints

from avssl_pyro.acoustics.covariance import inverse_and_logdet, spatial_covariance
from avssl_pyro.distributions.profiled_gaussian import (
    ObservedSpectrogram,
    component_log_likelihood,
    observe,
    quadratic_form,
)

# Least relative diffuse power that keeps a Cholesky factor of H in reach of each precision (M up to 16).
LEAST_DIFFUSE = {torch.complex64: 1e-3, torch.complex128: 1e-9}

# A sparse Dirichlet draws levels that underflow to the smallest normal number. Their logarithm must stay finite, and so
# must its derivative 1 / pi summed over up to 1e7 time-frequency bins.
LEAST_LEVEL_OVER_TINY = 1e8


class SpatialMixture(TorchDistribution):
    """x_tf ~ sum_k pi_k N_C(0, lambda_tfk H_fk) with H_fk = sum_d w_kd a_fd a_fd^H + eps I (Eqs. 8, 10).

    One draw is a whole spectrogram: ``batch_shape`` (B,), ``event_shape`` (F, M, T), complex. Without ``psd_bfkt`` the
    power spectral densities are replaced by their maximum-likelihood values (Eqs. 15, 16); with it the density is the
    proper mixture and the distribution can be sampled.

    Args:
        template_dfmm: templates a_fd a_fd^H, complex64 or complex128 (D, F, M, M); see ``template_covariances``.
        w: positive direction weights, (B..., K, D); only their ratios matter.
        pi: mixing levels, (B..., K), summing to 1.
        num_frames: number of frames T.
        diffuse: eps relative to the summed weights; at least 1e-3 in complex64.
        psd_bfkt: power spectral densities lambda, (B..., F, K, T), or None.

    Raises:
        ValueError: shapes do not agree, or ``diffuse`` is too small to invert covariances in this precision.
    """

    arg_constraints: ClassVar[dict[str, constraints.Constraint]] = {
        "w": constraints.independent(constraints.positive, 2),
        "pi": constraints.simplex,
    }
    support = constraints.independent(constraints.real, 3)
    has_rsample = False

    def __init__(
        self,
        template_dfmm: Tensor,
        w: Tensor,
        pi: Tensor,
        *,
        num_frames: int,
        diffuse: float = 0.1,
        psd_bfkt: Tensor | None = None,
        validate_args: bool | None = None,
    ) -> None:
        d, f, m, _ = template_dfmm.shape
        if w.shape[-1] != d or w.shape[-2] != pi.shape[-1]:
            raise ValueError(
                f"w {tuple(w.shape)} must be (..., K, D = {d}) and pi {tuple(pi.shape)} (..., K) with the same K."
            )
        psd_shape = (f, pi.shape[-1], num_frames)
        if psd_bfkt is not None and psd_bfkt.shape[-3:] != psd_shape:
            raise ValueError(f"psd_bfkt {tuple(psd_bfkt.shape)} must be (..., F, K, T) with (F, K, T) = {psd_shape}.")
        least = LEAST_DIFFUSE[template_dfmm.dtype]
        if not diffuse >= least:
            raise ValueError(f"diffuse = {diffuse} must be at least {least} in {template_dfmm.dtype}.")
        self.template_dfmm = template_dfmm
        self.diffuse = diffuse
        self.num_frames = num_frames
        self.w = w
        self.pi = pi
        self.psd_bfkt = psd_bfkt
        psd_batch = Size() if psd_bfkt is None else psd_bfkt.shape[:-3]
        batch_shape = torch.broadcast_shapes(w.shape[:-2], pi.shape[:-1], psd_batch)
        super().__init__(batch_shape, Size((f, m, num_frames)), validate_args=validate_args)

    def expand(self, batch_shape: Any, _instance: Any = None) -> "SpatialMixture":
        new: SpatialMixture = type(self).__new__(type(self)) if _instance is None else _instance
        # Everything, so that subclasses with more parameters need no expand.
        new.__dict__.update(self.__dict__)
        batch_shape = Size(batch_shape)
        new.w = self.w.expand(batch_shape + self.w.shape[-2:])
        new.pi = self.pi.expand(batch_shape + self.pi.shape[-1:])
        new.psd_bfkt = None if self.psd_bfkt is None else self.psd_bfkt.expand(batch_shape + self.psd_bfkt.shape[-3:])
        super(SpatialMixture, new).__init__(batch_shape, self.event_shape, validate_args=False)
        new._validate_args = bool(self.__dict__.get("_validate_args"))
        return new

    @property
    def can_be_sampled(self) -> bool:
        """Whether power spectral densities are known; profiled out, they leave nothing to draw from."""
        return self.psd_bfkt is not None

    def with_psd(self, psd_bfkt: Tensor) -> "SpatialMixture":
        """The same with known power spectral densities, broadcast against (B..., F, K, T)."""
        new = self.expand(self.batch_shape)
        new.psd_bfkt = psd_bfkt.expand(*self.batch_shape, *psd_bfkt.shape[-3:])
        return new

    @property
    def scm_bkfmm(self) -> Tensor:
        """Spatial covariance matrices H_fk, (B..., K, F, M, M)."""
        return spatial_covariance(self.w, self.template_dfmm, self.diffuse)

    def component_log_prob(self, value: Tensor | ObservedSpectrogram) -> Tensor:
        """log p(x_tf | z_tf = k), (B..., F, K, T)."""
        observed = observe(value) if isinstance(value, Tensor) else value
        if self.psd_bfkt is None:
            return component_log_likelihood(observed, self.scm_bkfmm)
        return _gaussian_log_likelihood(observed, self.scm_bkfmm, self.psd_bfkt)

    def joint_log_prob(self, value: Tensor | ObservedSpectrogram) -> Tensor:
        """log p(x_tf, z_tf = k), (B..., F, K, T)."""
        log_pi_bk = self.pi.clamp_min(LEAST_LEVEL_OVER_TINY * torch.finfo(self.pi.dtype).tiny).log()
        return log_pi_bk[..., None, :, None] + self.component_log_prob(value)

    def log_prob(self, value: Tensor | ObservedSpectrogram) -> Tensor:
        """log p(x) summed over the spectrogram, (B...): the logarithm inside Eq. (15)."""
        if self._validate_args and isinstance(value, Tensor):
            self._validate_sample(value)
        return self.joint_log_prob(value).logsumexp(dim=-2).sum(dim=(-2, -1))

    def masks(self, value: Tensor | ObservedSpectrogram) -> Tensor:
        """Posterior time-frequency masks p(z_tf = k | x), (B..., F, K, T), summing to 1 over k."""
        return self.joint_log_prob(value).softmax(dim=-2)

    @torch.no_grad()
    def sample(self, sample_shape: Any = ()) -> Tensor:
        """Draws spectrograms, (S..., B..., F, M, T).

        Raises:
            NotImplementedError: no power spectral density was given; profiled out, it leaves nothing to draw from.
        """
        if self.psd_bfkt is None:
            raise NotImplementedError(
                "SpatialMixture can be sampled only with a power spectral density: give psd_bfkt."
            )
        f, m, t = self.event_shape
        shape = Size(sample_shape) + self.batch_shape
        factor_bkfmm = torch.linalg.cholesky(self.scm_bkfmm)
        noise = torch.randn(*shape, 1, f, m, t, dtype=factor_bkfmm.dtype, device=factor_bkfmm.device)
        psd_bkfmt = self.psd_bfkt.transpose(-3, -2)[..., None, :]
        images_bkfmt = psd_bkfmt.sqrt() * (factor_bkfmm @ noise)
        index = self._draw_classes(Size(sample_shape))[..., None, :, None, :].expand(*shape, 1, f, m, t)
        return images_bkfmt.expand(*shape, -1, f, m, t).gather(-4, index).squeeze(-4)

    def _draw_classes(self, sample_shape: Size) -> Tensor:
        """z_tf, (S..., B..., F, T)."""
        f, _, t = self.event_shape
        level_bftk = self.pi[..., None, None, :].expand(*self.batch_shape, f, t, -1)
        return torch.distributions.Categorical(level_bftk).sample(sample_shape)


def _gaussian_log_likelihood(observed: ObservedSpectrogram, scm_bkfmm: Tensor, psd_bfkt: Tensor) -> Tensor:
    """log N_C(x_tf; 0, lambda_tfk H_fk) at a given lambda, (B..., F, K, T)."""
    inverse_bkfmm, logdet_bkf = inverse_and_logdet(scm_bkfmm)
    m = observed.num_microphones
    square_scale = (2 * observed.log_scale_b).exp()[..., None, None, None]
    mahalanobis = square_scale * quadratic_form(observed, inverse_bkfmm) / psd_bfkt
    return -m * (torch.pi * psd_bfkt).log() - logdet_bkf.transpose(-2, -1)[..., None] - mahalanobis

"""The spatial mixture with power spectral densities integrated over instead of profiled out."""

import math
from typing import Any

import torch
from pyro.distributions import InverseGamma
from torch import Size, Tensor

from avssl_pyro.acoustics.covariance import inverse_and_logdet
from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram, observe, quadratic_form
from avssl_pyro.distributions.spatial_mixture import SpatialMixture


class StudentMixture(SpatialMixture):
    """x_tf ~ sum_k pi_k N_C(0, lambda_tfk H_fk) with lambda_tfk ~ InvGamma(shape, scale), lambda integrated over.

    A component is the complex multivariate Student t

        p(x | k) = scale^a Gamma(a + M) / (pi^M Gamma(a) det H) (scale + x^H H^-1 x)^-(a + M),   a = shape.

    Both parameters going to 0 leads back to the profiled Gaussian of Eq. (16), up to a constant: that is Jeffreys'
    prior of lambda. Bins far below the scale carry no information on directions.

    Args:
        template_dfmm, w, pi, num_frames, diffuse: as of :class:`SpatialMixture`.
        psd_shape: shape of the inverse gamma prior, positive.
        psd_scale: scale of the inverse gamma prior, positive, in units of power of the spectrogram.
    """

    def __init__(
        self,
        template_dfmm: Tensor,
        w: Tensor,
        pi: Tensor,
        *,
        num_frames: int,
        psd_shape: float,
        psd_scale: float,
        diffuse: float = 0.1,
        validate_args: bool | None = None,
    ) -> None:
        self.psd_shape, self.psd_scale = psd_shape, psd_scale
        super().__init__(template_dfmm, w, pi, num_frames=num_frames, diffuse=diffuse, validate_args=validate_args)

    @property
    def can_be_sampled(self) -> bool:
        return True

    def component_log_prob(self, value: Tensor | ObservedSpectrogram) -> Tensor:
        observed = observe(value) if isinstance(value, Tensor) else value
        inverse_bkfmm, logdet_bkf = inverse_and_logdet(self.scm_bkfmm)
        m, a = observed.num_microphones, self.psd_shape
        quad_bfkt = quadratic_form(observed, inverse_bkfmm).clamp_min(0)
        log_scale = 2 * observed.log_scale_b[..., None, None, None]
        # log(scale + x^H P x) with x scaled; a silent clip would put scale / x^2 out of float32's reach.
        log_sum_bfkt = torch.logaddexp(
            quad_bfkt.clamp_min(torch.finfo(quad_bfkt.dtype).tiny).log() + log_scale,
            quad_bfkt.new_tensor(math.log(self.psd_scale)),
        )
        constant = math.lgamma(a + m) - math.lgamma(a) - m * math.log(math.pi) + a * math.log(self.psd_scale)
        return constant - logdet_bkf.transpose(-2, -1)[..., None] - (a + m) * log_sum_bfkt

    @torch.no_grad()
    def sample(self, sample_shape: Any = ()) -> Tensor:
        """Draws spectrograms, (S..., B..., F, M, T)."""
        f, _, t = self.event_shape
        like = self.pi.new_ones(*Size(sample_shape), *self.batch_shape, f, self.pi.shape[-1], t)
        psd_bfkt = InverseGamma(self.psd_shape * like, self.psd_scale * like).sample()
        gaussian = SpatialMixture(
            self.template_dfmm, self.w, self.pi, num_frames=t, diffuse=self.diffuse, psd_bfkt=psd_bfkt
        )
        return gaussian.sample()

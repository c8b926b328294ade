"""Likelihoods of a spectrogram: small, exchangeable objects that return a distribution of x given w and pi.

A likelihood may also return its density as a function of x^H H^-1 x (``density_generator``), for MAP-EM.
"""

import math
from typing import Protocol

import torch
from attrs import field, frozen
from pyro.distributions import TorchDistribution
from torch import Tensor

from avssl_pyro.distributions.activity_mixture import ActivityMixture
from avssl_pyro.distributions.e_step import DensityGenerator
from avssl_pyro.distributions.precedence import PrecedenceMixture, log_decay_of, precedence_weights
from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram
from avssl_pyro.distributions.spatial_mixture import SpatialMixture
from avssl_pyro.distributions.student_mixture import StudentMixture
from avssl_pyro.validators import Requirement, between, positive


class Likelihood(Protocol):
    """A distribution of a spectrogram (site ``spectrogram``)."""

    def __call__(
        self, template_dfmm: Tensor, w_bkd: Tensor, pi_bk: Tensor, num_frames: int, diffuse: float
    ) -> TorchDistribution:
        """Returns p(x | w, pi), batch_shape (B,), event_shape (F, M, T).

        Args:
            template_dfmm: templates a_fd a_fd^H of every direction, complex (D, F, M, M).
            w_bkd, pi_bk: direction weights and mixing levels.
            num_frames: number of frames T.
            diffuse: eps relative to the summed weights.
        """
        ...


@frozen
class ProfiledGaussian:
    """The paper's: power spectral densities at their maximum-likelihood values (Eqs. 15, 16).

    >>> from avssl_pyro.systems.pretrained import load_weights_of
    >>> load_weights_of("circle4").model_with(likelihood=ProfiledGaussian()).likelihood
    ProfiledGaussian()
    """

    def __call__(
        self, template_dfmm: Tensor, w_bkd: Tensor, pi_bk: Tensor, num_frames: int, diffuse: float
    ) -> SpatialMixture:
        return SpatialMixture(template_dfmm, w_bkd, pi_bk, num_frames=num_frames, diffuse=diffuse)

    def density_generator(self, observed: ObservedSpectrogram) -> DensityGenerator:
        """Power and offset for :class:`avssl_pyro.distributions.map_em.MapEM`."""
        return DensityGenerator(observed.num_microphones, observed.num_microphones * observed.floor_b)


@frozen
class PrecedenceGaussian:
    """:class:`ProfiledGaussian` in which onsets count more than what may be their reverberation.

    Args:
        decay_s: time in which reverberation is taken to fall by 60 dB, seconds.
        frame_s: time from frame to frame, seconds.
        least: least weight of a bin before weights are scaled to mean 1.

    >>> PrecedenceGaussian(decay_s=0.3)
    PrecedenceGaussian(decay_s=0.3, frame_s=0.01, least=0.05)
    """

    decay_s: float = field(default=0.5, validator=positive)
    frame_s: float = field(default=0.01, validator=positive)
    least: float = field(default=0.05, validator=between(0, 1))

    def __call__(
        self, template_dfmm: Tensor, w_bkd: Tensor, pi_bk: Tensor, num_frames: int, diffuse: float
    ) -> PrecedenceMixture:
        return PrecedenceMixture(
            template_dfmm,
            w_bkd,
            pi_bk,
            num_frames=num_frames,
            diffuse=diffuse,
            log_decay=log_decay_of(self.decay_s, self.frame_s),
            least=self.least,
        )

    def density_generator(self, observed: ObservedSpectrogram) -> DensityGenerator:
        """Power and offset for :class:`avssl_pyro.distributions.map_em.MapEM`."""
        return DensityGenerator(observed.num_microphones, observed.num_microphones * observed.floor_b)

    def bin_weights(self, observed: ObservedSpectrogram) -> Tensor:
        """Weights c_tf of the bins of a whole spectrogram, (B, F, T)."""
        return precedence_weights(observed, log_decay_of(self.decay_s, self.frame_s), self.least)


@frozen
class InverseGammaPsd:
    """Power spectral densities are latent, lambda ~ InvGamma(shape, scale), and integrated over: a complex Student t.

    Args:
        shape: shape of the prior; the larger, the closer to a Gaussian of one known power.
        scale: scale in units of power of the spectrogram; a bin far below it carries no information on directions.
    """

    shape: float = field(default=0.5, validator=positive)
    scale: float = field(default=1e-3, validator=positive)

    def __call__(
        self, template_dfmm: Tensor, w_bkd: Tensor, pi_bk: Tensor, num_frames: int, diffuse: float
    ) -> StudentMixture:
        return StudentMixture(
            template_dfmm,
            w_bkd,
            pi_bk,
            num_frames=num_frames,
            psd_shape=self.shape,
            psd_scale=self.scale,
            diffuse=diffuse,
        )

    def density_generator(self, observed: ObservedSpectrogram) -> DensityGenerator:
        """Power and offset for :class:`avssl_pyro.distributions.map_em.MapEM`."""
        largest = torch.finfo(observed.floor_b.dtype).max ** 0.5
        offset_b = (math.log(self.scale) - 2 * observed.log_scale_b).exp().clamp_max(largest)
        return DensityGenerator(observed.num_microphones + self.shape, torch.maximum(offset_b, observed.floor_b))


@frozen
class FrameActivity:
    """The paper's likelihood with separate levels in every frame, for classes that pause.

    Args:
        activity: prior probability that a class is active in a frame.
        most_active: largest number of classes active in one frame; None for all. Fewer are faster.
    """

    activity: float = field(default=0.5, validator=between(0, 1))
    most_active: int | None = field(
        default=None, validator=Requirement(lambda value: value is None or value >= 1, "at least 1, or None for all")
    )

    def __call__(
        self, template_dfmm: Tensor, w_bkd: Tensor, pi_bk: Tensor, num_frames: int, diffuse: float
    ) -> ActivityMixture:
        return ActivityMixture(
            template_dfmm,
            w_bkd,
            pi_bk,
            num_frames=num_frames,
            activity=self.activity,
            most_active=self.most_active,
            diffuse=diffuse,
        )

"""An amortized guide with a posterior of the diffuse weights, for models with a room."""

import math

import pyro
import pyro.distributions as dist
import torch
from pyro.distributions import TorchDistribution
from torch import Tensor, nn

from avssl_pyro.guides.amortized import AmortizedGuide
from avssl_pyro.guides.base import GuideParameters
from avssl_pyro.networks.audio import AudioNet
from avssl_pyro.networks.visual import VisualNet


class DiffuseAmortizedGuide(AmortizedGuide):
    """:class:`AmortizedGuide` with q(e) = LogNormal(mu_kc, sigma_kc^2), both learned and common to all clips.

    Args:
        visual, audio: networks, as of :class:`AmortizedGuide`.
        num_components: number of the room's diffuse components C.
        initial_mu: mu_kc before training.
        initial_sigma, initial_beta, diffuse_class: as of :class:`AmortizedGuide`; sigma_kc starts at initial_sigma too.
    """

    def __init__(
        self,
        visual: VisualNet,
        audio: AudioNet,
        num_components: int,
        initial_mu: float = 2.0,
        initial_sigma: float = 0.3,
        initial_beta: float = 100.0,
        diffuse_class: bool = False,
    ) -> None:
        super().__init__(visual, audio, initial_sigma, initial_beta, diffuse_class)
        shape = (self.num_sources, num_components)
        self.diffuse_mu_kc = nn.Parameter(torch.full(shape, initial_mu))
        self.diffuse_log_sigma_kc = nn.Parameter(torch.full(shape, math.log(initial_sigma)))

    def diffuse_posterior(self) -> TorchDistribution:
        """q(e), event_shape (K, C)."""
        return dist.LogNormal(self.diffuse_mu_kc, self.diffuse_log_sigma_kc.exp()).to_event(2)

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        mu_bkd, _ = self.log_weights(image_bcij)
        feature_bcdt = self.audio.direction_features(x_bfmt)
        with pyro.plate("clip", x_bfmt.shape[0], dim=-1):
            w_bkd = pyro.sample("direction_weights", self.direction_posterior(mu_bkd))
            pyro.sample("mixing_levels", dist.Dirichlet(self.concentration(feature_bcdt, w_bkd)))
            pyro.sample("diffuse_weights", self.diffuse_posterior())

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        """As of :class:`AmortizedGuide`, with those of log e."""
        known = super().parameters_of(x_bfmt, image_bcij)
        shape_bkc = (len(known.mu_bkd), *self.diffuse_mu_kc.shape)
        return known._replace(
            diffuse_mu_bkc=self.diffuse_mu_kc.expand(shape_bkc),
            diffuse_sigma_bkc=self.diffuse_log_sigma_kc.exp().expand(shape_bkc),
        )

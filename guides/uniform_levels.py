"""The guide without an audio network, "w/o Aud" of the paper's Sec. IV: every source class is equally loud."""

import pyro
import pyro.distributions as dist
import torch
from torch import Tensor

from avssl_pyro.guides.base import DirectionGuide, GuideParameters


class UniformLevelGuide(DirectionGuide):
    """q(w | image) as in :class:`DirectionGuide`; pi is fixed to 1/K."""

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        mu_bkd, _ = self.log_weights(image_bcij)
        with pyro.plate("clip", x_bfmt.shape[0], dim=-1):
            pyro.sample("direction_weights", self.direction_posterior(mu_bkd))
            levels_k = mu_bkd.new_full((mu_bkd.shape[-2],), 1 / mu_bkd.shape[-2])
            pyro.sample("mixing_levels", dist.Delta(levels_k, event_dim=1))

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:  # noqa: ARG002
        """The posterior's parameters; the concentrations are equal and so large that the levels are certain."""
        mu_bkd, activation_bkij = self.log_weights(image_bcij)
        concentration_bk = mu_bkd.new_full(mu_bkd.shape[:-1], 1 / torch.finfo(mu_bkd.dtype).eps)
        return GuideParameters(mu_bkd, self.sigma(mu_bkd), concentration_bk, activation_bkij)

"""A posterior that is known already, as a guide: what a guide that fits every clip leaves when it is done."""

import pyro
import pyro.distributions as dist
from torch import Tensor, nn

from avssl_pyro.guides.base import GuideParameters


class FixedGuide(nn.Module):
    """q(w) = LogNormal(mu, sigma^2) and q(pi) = Dir(concentration) of the very clips it was made of.

    Args:
        parameters: of B clips; spectrograms and images are not looked at again.
    """

    fits_each_clip = True

    def __init__(self, parameters: GuideParameters) -> None:
        super().__init__()
        self.parameters_of_clips = parameters

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:  # noqa: ARG002
        mu_bkd, sigma_bkd, concentration_bk, _ = self.parameters_of_clips
        with pyro.plate("clip", len(mu_bkd), dim=-1):
            pyro.sample("direction_weights", dist.LogNormal(mu_bkd, sigma_bkd).to_event(2))
            pyro.sample("mixing_levels", dist.Dirichlet(concentration_bk))

    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:  # noqa: ARG002
        """The known parameters."""
        return self.parameters_of_clips

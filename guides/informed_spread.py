"""The refined guide with the spread that the recording's information leaves, in place of the ascent's lower bound."""

import pyro
import pyro.distributions as dist
import torch
from torch import Tensor, nn

from avssl_pyro.acoustics.covariance import template_covariances
from avssl_pyro.distributions.information import mixture_information
from avssl_pyro.distributions.profiled_gaussian import observe
from avssl_pyro.guides.amortized import LEAST_CONCENTRATION
from avssl_pyro.guides.directions import GuideParameters
from avssl_pyro.guides.refined import RefinedGuide


class InformedSpreadGuide(nn.Module):
    """q(w) = LogNormal(mu, sigma^2) and q(pi) = Dir(c): means refined, spreads by Fisher information.

    It holds for the profiled Gaussian likelihood with log-normal weights and Dirichlet levels, as refinement does.

    Args:
        refined: where the means come from; its settings are used here, too.
        steering_fdm: steering vectors of the spectrogram's frequencies, complex (F, D, M).
    """

    def __init__(self, refined: RefinedGuide, steering_fdm: Tensor) -> None:
        super().__init__()
        self.refined = refined
        self.template_pairs: Tensor
        template_dfmm = template_covariances(steering_fdm)
        self.register_buffer("template_pairs", torch.view_as_real(template_dfmm), persistent=False)

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        parameters = self.parameters_of(x_bfmt, image_bcij)
        with pyro.plate("clip", x_bfmt.shape[0], dim=-1):
            pyro.sample("direction_weights", dist.LogNormal(parameters.mu_bkd, parameters.sigma_bkd).to_event(2))
            pyro.sample("mixing_levels", dist.Dirichlet(parameters.concentration_bk))

    @torch.no_grad()
    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        """The posterior's parameters."""
        config = self.refined.config
        parameters = self.refined.parameters_of(x_bfmt, image_bcij)
        concentration_bk = parameters.concentration_bk
        information = mixture_information(
            observe(x_bfmt),
            torch.view_as_complex(self.template_pairs),
            config.diffuse,
            parameters.mu_bkd,
            concentration_bk / concentration_bk.sum(-1, keepdim=True),
        )
        precision_bkd = config.bin_weight * information.log_weights_bkd + config.prior_sigma**-2
        counts_bk = information.levels_b[:, None] * (concentration_bk - config.alpha).clamp_min(0)
        return parameters._replace(
            sigma_bkd=precision_bkd.rsqrt(),
            concentration_bk=(counts_bk + config.alpha).clamp_min(LEAST_CONCENTRATION),
        )

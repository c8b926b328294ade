"""The refined guide with the spread that the recording's information leaves, in place of the ascent's lower bound."""

import torch
from torch import Tensor, nn

from avssl_pyro.distributions.information import mixture_information
from avssl_pyro.distributions.profiled_gaussian import observe
from avssl_pyro.errors import InputError
from avssl_pyro.guides.amortized import LEAST_CONCENTRATION
from avssl_pyro.guides.directions import GuideParameters
from avssl_pyro.guides.fitted import FittedPosterior
from avssl_pyro.guides.model_ascent import CountedLevels, SmoothWeights
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.models.likelihoods import ProfiledGaussian


class InformedSpreadGuide(nn.Module):
    """q(w) = LogNormal(mu, sigma^2) and q(pi) = Dir(c): means refined, spreads by Fisher information.

    1 / sigma^2 is the information of the clip on a log-weight plus the prior's curvature, all else known; c are the
    refined counts times the share of their information that unobserved masks leave, plus those of the prior.

    Args:
        refined: where the means come from.

    Raises:
        InputError: the model's likelihood is not the profiled Gaussian.
    """

    fits_each_clip = True

    def __init__(self, refined: RefinedGuide) -> None:
        super().__init__()
        if not isinstance(refined.model.likelihood, ProfiledGaussian):
            raise InputError(
                f"InformedSpreadGuide: the information of {refined.model.likelihood} is not known; use a "
                "PerSceneGuide, which needs gradients alone."
            )
        self.refined = refined

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        self.fitted_to(x_bfmt, image_bcij)(x_bfmt, image_bcij)

    def fitted_to(self, x_bfmt: Tensor, image_bcij: Tensor) -> FittedPosterior:
        """A guide of these clips, to be used more than once."""
        return FittedPosterior(self.parameters_of(x_bfmt, image_bcij))

    @torch.no_grad()
    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        """The posterior's parameters."""
        model = self.refined.model
        # Refinement asked for them.
        assert isinstance(model.direction_prior, SmoothWeights)
        assert isinstance(model.level_prior, CountedLevels)
        mu_bkd, _, counts_bk, activation_bkij = self.refined.parameters_of(x_bfmt, image_bcij)
        information = mixture_information(
            observe(x_bfmt), model.template_dfmm, model.diffuse, mu_bkd, counts_bk / counts_bk.sum(-1, keepdim=True)
        )
        prior_bkd = model.direction_prior.of_log_weights(mu_bkd.shape[-1], mu_bkd).precision(mu_bkd)
        precision_bkd = model.bin_weight * information.log_weights_bkd + prior_bkd
        alpha_k = model.level_prior.pseudo_counts(mu_bkd.shape[-2], mu_bkd)
        heard_bk = information.levels_b[:, None] * (counts_bk - alpha_k).clamp_min(0)
        concentration_bk = (alpha_k + heard_bk).clamp_min(LEAST_CONCENTRATION)
        return GuideParameters(mu_bkd, precision_bkd.rsqrt(), concentration_bk, activation_bkij)

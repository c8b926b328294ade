"""The semi-amortised guide: the networks' posterior of a clip, refined on that clip alone.

A single forward pass knows what such pictures and recordings have in common; a few rounds of closed-form ascent of the
posterior fit the one at hand. The visual network says where to start and, if wanted, gives a prior that keeps the
picture in. All classes start at equal levels: one that starts quiet stays so, and a talker it alone looks at is lost.
The standard deviations of log w come from the expected information, see :mod:`avssl_pyro.distributions.map_em`. Priors
and likelihood are the model's, see :mod:`avssl_pyro.guides.conjugacy` for those that can be swapped.
"""

import torch
import torch.nn.functional as F
from pyro.nn import PyroModule
from torch import Tensor

from avssl_pyro.errors import InputError
from avssl_pyro.guides.amortized import LEAST_CONCENTRATION
from avssl_pyro.guides.base import GuideParameters, Initializer
from avssl_pyro.guides.conjugacy import check_map_em, map_em_of
from avssl_pyro.guides.fixed import FixedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.models.spatial_cgmm import SpatialCGMM


class RefinedGuide(PyroModule):
    """q(w) = LogNormal(mu, sigma^2) and q(pi) = Dir(counts), each clip with parameters of its own.

    Args:
        start: the trained guide, or another start; it is not changed.
        model: whose posterior is climbed.
        config: how far to go.

    Raises:
        InputError: a prior or the likelihood of the model does not say how the ascent can take it in, or start and
            model do not go together.

    >>> from avssl_pyro.systems.pretrained import load_weights_of
    >>> system = load_weights_of("circle4")
    >>> RefinedGuide(system.guide, system.model, RefinementConfig(rounds=10)).num_sources
    9
    """

    fits_each_clip = True

    def __init__(
        self,
        start: Initializer,
        model: SpatialCGMM,
        config: RefinementConfig | None = None,
    ) -> None:
        super().__init__()
        config = RefinementConfig() if config is None else config
        if not hasattr(start, "log_weights"):
            raise InputError(
                f"RefinedGuide: {type(start).__name__} has no 'log_weights' to start at; give one of networks, such "
                "as a system's, or a UninformedInitializer."
            )
        found = getattr(start, "num_sources", model.num_sources) + config.extra_classes
        if found != model.num_sources:
            raise InputError(
                f"RefinedGuide: the start has {found} source classes, those added included, and the model "
                f"{model.num_sources}; give both the same."
            )
        check_map_em(model)
        self.start = start
        self.model = model
        self.num_sources = model.num_sources
        self.config = config

    def forward(self, x_bfmt: Tensor, image_bcij: Tensor) -> None:
        self.fitted_to(x_bfmt, image_bcij)(x_bfmt, image_bcij)

    def fitted_to(self, x_bfmt: Tensor, image_bcij: Tensor) -> FixedGuide:
        """A guide of these clips, to be used more than once without climbing again."""
        return FixedGuide(self.parameters_of(x_bfmt, image_bcij))

    @torch.no_grad()
    def parameters_of(self, x_bfmt: Tensor, image_bcij: Tensor) -> GuideParameters:
        """The refined posterior's parameters."""
        config = self.config
        mu_bkd, activation_bkij = self.start.log_weights(image_bcij)
        mu_bkd = F.pad(mu_bkd, (0, 0, 0, config.extra_classes))
        activation_bkij = F.pad(activation_bkij, (0, 0, 0, 0, 0, config.extra_classes))
        map_em = map_em_of(
            self.model,
            x_bfmt,
            mu_bkd,
            bin_step=config.bin_step,
            frame_step=config.frame_step,
            prior_mean=config.image_weight * mu_bkd,
        )
        state = map_em.fit(config.softening * mu_bkd, config.rounds, tolerance=config.tolerance)
        sigma_bkd, concentration_bk = map_em.uncertainty(state)
        return GuideParameters(
            mu_bkd=state.log_w_bkd,
            sigma_bkd=sigma_bkd,
            concentration_bk=concentration_bk.clamp_min(LEAST_CONCENTRATION),
            activation_bkij=activation_bkij + _over_columns(state.log_w_bkd - mu_bkd, activation_bkij),
        )


def _over_columns(change_bkd: Tensor, activation_bkij: Tensor) -> Tensor:
    """A change of log-weights laid over the columns of the activation maps, (B, K, 1, J')."""
    return F.interpolate(change_bkd[:, :, None], size=(1, activation_bkij.shape[-1]))

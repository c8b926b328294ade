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

from avssl_pyro.distributions.map_em import MapEM, MapEMState
from avssl_pyro.errors import InputError
from avssl_pyro.guides.amortized import LEAST_CONCENTRATION
from avssl_pyro.guides.base import GuideParameters, Initializer
from avssl_pyro.guides.conjugacy import check_ascent, model_ascent
from avssl_pyro.guides.fixed import FixedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.models.spatial_cgmm import SpatialCGMM

# Twice the closed-form step, until it overshoots for the first time.
OVERRELAXATION = 2.0


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
        check_ascent(model)
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
        equal_bk = mu_bkd.new_full(mu_bkd.shape[:-1], 1 / mu_bkd.shape[-2])
        ascent = self._ascent(x_bfmt, mu_bkd)
        point = self._climb(ascent, config.softening * mu_bkd, equal_bk)
        sigma_bkd, concentration_bk = ascent.uncertainty(point)
        return GuideParameters(
            mu_bkd=point.log_w_bkd,
            sigma_bkd=sigma_bkd,
            concentration_bk=concentration_bk.clamp_min(LEAST_CONCENTRATION),
            activation_bkij=activation_bkij + _over_columns(point.log_w_bkd - mu_bkd, activation_bkij),
        )

    def _ascent(self, x_bfmt: Tensor, mu_bkd: Tensor) -> MapEM:
        config = self.config
        return model_ascent(
            self.model,
            x_bfmt,
            mu_bkd,
            bin_step=config.bin_step,
            frame_step=config.frame_step,
            prior_mean=config.image_weight * mu_bkd,
        )

    def _climb(self, ascent: MapEM, log_w_bkd: Tensor, pi_bk: Tensor) -> MapEMState:
        point = ascent.step(log_w_bkd, pi_bk)
        climbing_b = torch.ones_like(point.objective_b, dtype=torch.bool)
        stretch_b = torch.full_like(point.objective_b, OVERRELAXATION)
        # What a step has gained is known at the next one, when another has been stretched already.
        stretched_b = torch.zeros_like(climbing_b)
        for _ in range(self.config.rounds - 1):
            above = ascent.step(point.log_w_bkd, point.pi_bk, stretch_b)
            gain_b = (above.objective_b - point.objective_b) / point.counts_bk.sum(-1)
            # A clip that has arrived stays there, so that its result does not depend on its batch.
            point = point.choose(climbing_b, above)
            # One that fell was stretched too far, and has not arrived.
            climbing_b = climbing_b & ((gain_b > self.config.tolerance) | (gain_b < 0) & stretched_b)
            stretched_b = stretch_b > 1
            stretch_b = torch.where(gain_b < 0, 1.0, stretch_b)
            if not climbing_b.any():
                break
        return point


def _over_columns(change_bkd: Tensor, activation_bkij: Tensor) -> Tensor:
    """A change of log-weights laid over the columns of the activation maps, (B, K, 1, J')."""
    return F.interpolate(change_bkd[:, :, None], size=(1, activation_bkij.shape[-1]))

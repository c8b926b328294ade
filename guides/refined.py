"""The semi-amortised guide: the networks' posterior of a clip, refined by MAP-EM on that clip alone.

A forward pass of the networks uses what is common to all clips; a few rounds of MAP-EM fit the clip at hand. The
visual network gives the start and, with ``image_weight``, the prior mean of log w. Standard deviations of log w come
from the expected information, see :mod:`avssl_pyro.distributions.map_em`. Priors and likelihood are those of the
model, see :mod:`avssl_pyro.guides.conjugacy` for those that can be swapped.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from avssl_pyro.errors import InputError
from avssl_pyro.guides.amortized import LEAST_CONCENTRATION
from avssl_pyro.guides.base import ClipFittedGuide, FixedGuide, GuideParameters, Initializer
from avssl_pyro.guides.conjugacy import check_map_em, map_em_of
from avssl_pyro.guides.diffuse_start import with_diffuse_start
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.models.spatial_cgmm import SpatialCGMM


class RefinedGuide(ClipFittedGuide):
    """q(w) = LogNormal(mu, sigma^2) and q(pi) = Dir(counts), with separate parameters for every clip.

    Args:
        start: trained guide or other initializer; it is not changed.
        model: model whose posterior is maximised.
        config: settings of the refinement.

    Raises:
        InputError: a prior or the likelihood of the model lacks the method that MAP-EM needs, or start and model
            differ in their numbers of classes.

    >>> from avssl_pyro.systems.pretrained import load_weights_of
    >>> system = load_weights_of("circle4")
    >>> RefinedGuide(system.guide, system.model, RefinementConfig(rounds=10)).num_sources
    9
    """

    def __init__(self, start: Initializer, model: SpatialCGMM, config: RefinementConfig | None = None) -> None:
        super().__init__()
        config = RefinementConfig() if config is None else config
        if not hasattr(start, "log_weights"):
            raise InputError(
                f"RefinedGuide: {type(start).__name__} has no 'log_weights' to start at; use a guide with "
                "networks, such as a system's, or an UninformedInitializer."
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

    @torch.no_grad()
    def fitted_to(self, x_bfmt: Tensor, image_bcij: Tensor) -> FixedGuide:
        """Refines the posterior of these clips."""
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
        components = self.model.num_diffuse
        start_bkj = with_diffuse_start(config.softening * mu_bkd, components, config.diffuse_start)
        state = map_em.fit(start_bkj, config.rounds, tolerance=config.tolerance)
        sigma_bkj, concentration_bk = map_em.uncertainty(state)
        d = mu_bkd.shape[-1]
        log_w_bkd = state.log_w_bkd[..., :d]
        parameters = GuideParameters(
            mu_bkd=log_w_bkd,
            sigma_bkd=sigma_bkj[..., :d],
            concentration_bk=concentration_bk.clamp_min(LEAST_CONCENTRATION),
            activation_bkij=activation_bkij + _over_columns(log_w_bkd - mu_bkd, activation_bkij),
            diffuse_mu_bkc=state.log_w_bkd[..., d:] if components else None,
            diffuse_sigma_bkc=sigma_bkj[..., d:] if components else None,
        )
        return FixedGuide(parameters)


def _over_columns(change_bkd: Tensor, activation_bkij: Tensor) -> Tensor:
    """A change of log-weights resampled to the columns of the activation maps, (B, K, 1, J')."""
    return F.interpolate(change_bkd[:, :, None], size=(1, activation_bkij.shape[-1]))

"""Families of Gaussians for single clips, each fitted through one of Pyro's autoguides."""

from collections.abc import Callable
from typing import Any, Protocol

import torch
from attrs import field, frozen
from pyro.infer.autoguide import AutoGuide, AutoLowRankMultivariateNormal, AutoNormal
from pyro.infer.autoguide.initialization import init_to_value
from torch import Tensor
from torch.distributions import StickBreakingTransform

from avssl_pyro.errors import InputError
from avssl_pyro.guides.unconstrained_gaussian import UnconstrainedGaussian
from avssl_pyro.validators import at_least

SITES = ["direction_weights", "mixing_levels"]
# Initial loadings of shared factors relative to the spread; zero loadings would stay zero.
FIRST_LOADING = 0.1

ClipModel = Callable[[Tensor, Tensor], None]
"""A model of clips (x_bfmt, image_bcij) with the latent sites ``SITES`` in a plate of clips, such as SpatialCGMM."""


class GaussianFamily(Protocol):
    """A family of Gaussians of the unconstrained latents of one clip."""

    def autoguide(
        self, model: ClipModel, start: UnconstrainedGaussian, x_bfmt: Tensor, image_bcij: Tensor
    ) -> AutoGuide:
        """An autoguide for the given clip, with the parameters of ``start``."""
        ...

    def posterior(self, autoguide: AutoGuide, num_sources: int) -> UnconstrainedGaussian:
        """The Gaussian that the autoguide has been fitted to."""
        ...


@frozen
class MeanField:
    """Independent latents: Pyro's AutoNormal."""

    def autoguide(
        self, model: ClipModel, start: UnconstrainedGaussian, x_bfmt: Tensor, image_bcij: Tensor
    ) -> AutoGuide:
        guide = AutoNormal(model, init_loc_fn=_at_means(start))
        _set_up(guide, x_bfmt, image_bcij)
        # Set here and not through values of the sites, which do not resolve nearly empty classes.
        guide.locs.mixing_levels.data.copy_(start.loc_bn[:, start.num_weights :])
        guide.scales.direction_weights = start.sigma_bkd
        guide.scales.mixing_levels = start.scale_bn[:, start.num_weights :]
        return guide

    def posterior(self, autoguide: AutoGuide, num_sources: int) -> UnconstrainedGaussian:
        loc_bn, scale_bn = (
            torch.cat([values.direction_weights.flatten(-2), values.mixing_levels], dim=-1).detach()
            for values in (autoguide.locs, autoguide.scales)
        )
        return UnconstrainedGaussian(loc_bn, scale_bn, loc_bn.new_zeros(*loc_bn.shape, 0), num_sources)


@frozen
class LowRank:
    """Independent latents plus ``rank`` shared factors: Pyro's AutoLowRankMultivariateNormal."""

    rank: int = field(default=8, validator=at_least(1))

    def autoguide(
        self, model: ClipModel, start: UnconstrainedGaussian, x_bfmt: Tensor, image_bcij: Tensor
    ) -> AutoGuide:
        guide = AutoLowRankMultivariateNormal(model, init_loc_fn=_at_means(start), rank=self.rank)
        _set_up(guide, x_bfmt, image_bcij)
        place_n = _sites_in_order(guide, start.num_sources).argsort()
        guide.loc.data.copy_(start.loc_bn[0, place_n])
        guide.scale = start.scale_bn[0, place_n]  # type: ignore[assignment]
        # Loadings are relative to the scale.
        guide.cov_factor.data.mul_(FIRST_LOADING)
        return guide

    def posterior(self, autoguide: AutoGuide, num_sources: int) -> UnconstrainedGaussian:
        order_n = _sites_in_order(autoguide, num_sources)
        loc_n, scale_n = autoguide.loc.detach()[order_n], autoguide.scale.detach()[order_n]
        factor_nr = autoguide.cov_factor.detach()[order_n] * scale_n[:, None]
        return UnconstrainedGaussian(loc_n[None], scale_n[None], factor_nr[None], num_sources)


def _at_means(start: UnconstrainedGaussian) -> Callable[[dict[str, Any]], Tensor]:
    level_bk = StickBreakingTransform()(start.loc_bn[:, start.num_weights :])
    return init_to_value(values=dict(zip(SITES, (start.mu_bkd.exp(), level_bk), strict=True)))


def _set_up(autoguide: AutoGuide, x_bfmt: Tensor, image_bcij: Tensor) -> None:
    """An autoguide makes its parameters when it is first called."""
    autoguide(x_bfmt, image_bcij)
    found = _sites(autoguide)
    if sorted(found) != SITES:
        raise InputError(
            f"PerClipGuide: the model has the latent sites {', '.join(found)}; "
            f"it must have {' and '.join(SITES)} alone."
        )


def _sites(autoguide: AutoGuide) -> list[str]:
    assert autoguide.prototype_trace is not None
    return [name for name, _ in autoguide.prototype_trace.iter_stochastic_nodes()]


def _sites_in_order(autoguide: Any, num_sources: int) -> Tensor:
    """Where in the autoguide's latent vector the log-weights are, then the sticks: a model may draw either first."""
    index_n = torch.arange(autoguide.latent_dim)
    return index_n if _sites(autoguide) == SITES else index_n.roll(1 - num_sources)

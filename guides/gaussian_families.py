"""Families of Gaussians for single clips, each fitted through one of Pyro's autoguides."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import torch
from attrs import field, frozen
from pyro.infer.autoguide import AutoGuide, AutoLowRankMultivariateNormal, AutoNormal
from pyro.infer.autoguide.initialization import init_to_value
from torch import Tensor

from avssl_pyro.errors import InputError
from avssl_pyro.guides.unconstrained_gaussian import UnconstrainedGaussian
from avssl_pyro.validators import at_least

# In the order of the latents of UnconstrainedGaussian; the last is of models with a room.
SITES = ["direction_weights", "mixing_levels", "diffuse_weights"]
# Initial loadings of shared factors relative to the spread; zero loadings would stay zero.
FIRST_LOADING = 0.1

ClipModel = Callable[[Tensor, Tensor], None]
"""A model of clips (x_bfmt, image_bcij) with latent sites ``SITES`` in a plate of clips, such as SpatialCGMM."""


class GaussianFamily(Protocol):
    """A family of Gaussians of the unconstrained latents of one clip."""

    def autoguide(
        self, model: ClipModel, start: UnconstrainedGaussian, x_bfmt: Tensor, image_bcij: Tensor
    ) -> AutoGuide:
        """An autoguide for the given clip, with the parameters of ``start``."""
        ...

    def posterior(self, autoguide: AutoGuide, start: UnconstrainedGaussian) -> UnconstrainedGaussian:
        """The Gaussian that the autoguide has been fitted to, of the sizes of ``start``."""
        ...


@frozen
class MeanField:
    """Independent latents: Pyro's AutoNormal."""

    def autoguide(
        self, model: ClipModel, start: UnconstrainedGaussian, x_bfmt: Tensor, image_bcij: Tensor
    ) -> AutoGuide:
        guide = AutoNormal(model, init_loc_fn=_at_means(start))
        _set_up(guide, start, x_bfmt, image_bcij)
        sites = _sites_of(start)
        # Set here and not through values of the sites, which do not resolve nearly empty classes.
        guide.locs.mixing_levels.data.copy_(start.split(start.loc_bn)[1])
        marginal = {"direction_weights": start.sigma_bkd, "diffuse_weights": start.diffuse_sigma_bkc}
        for site, scale in zip(sites, start.split(start.scale_bn), strict=False):
            setattr(guide.scales, site, marginal.get(site, scale))
        return guide

    def posterior(self, autoguide: AutoGuide, start: UnconstrainedGaussian) -> UnconstrainedGaussian:
        batch_shape = start.loc_bn.shape[:-1]
        loc_bn, scale_bn = (
            torch.cat([getattr(values, site).reshape(*batch_shape, -1) for site in _sites_of(start)], dim=-1).detach()
            for values in (autoguide.locs, autoguide.scales)
        )
        return replace(start, loc_bn=loc_bn, scale_bn=scale_bn, factor_bnr=loc_bn.new_zeros(*loc_bn.shape, 0))


@frozen
class LowRank:
    """Independent latents plus ``rank`` shared factors: Pyro's AutoLowRankMultivariateNormal."""

    rank: int = field(default=8, validator=at_least(1))

    def autoguide(
        self, model: ClipModel, start: UnconstrainedGaussian, x_bfmt: Tensor, image_bcij: Tensor
    ) -> AutoGuide:
        guide = AutoLowRankMultivariateNormal(model, init_loc_fn=_at_means(start), rank=self.rank)
        _set_up(guide, start, x_bfmt, image_bcij)
        place_n = _sites_in_order(guide, start).argsort()
        guide.loc.data.copy_(start.loc_bn[0, place_n])
        guide.scale = start.scale_bn[0, place_n]  # type: ignore[assignment]
        # Loadings are relative to the scale.
        guide.cov_factor.data.mul_(FIRST_LOADING)
        return guide

    def posterior(self, autoguide: AutoGuide, start: UnconstrainedGaussian) -> UnconstrainedGaussian:
        order_n = _sites_in_order(autoguide, start)
        loc_n, scale_n = autoguide.loc.detach()[order_n], autoguide.scale.detach()[order_n]
        factor_nr = autoguide.cov_factor.detach()[order_n] * scale_n[:, None]
        return replace(start, loc_bn=loc_n[None], scale_bn=scale_n[None], factor_bnr=factor_nr[None])


def _at_means(start: UnconstrainedGaussian) -> Callable[[dict[str, Any]], Tensor]:
    values, _ = start.sites_of(start.loc_bn)
    return init_to_value(values=values)


def _set_up(autoguide: AutoGuide, start: UnconstrainedGaussian, x_bfmt: Tensor, image_bcij: Tensor) -> None:
    """An autoguide makes its parameters when it is first called."""
    autoguide(x_bfmt, image_bcij)
    found, expected = _sites(autoguide), _sites_of(start)
    if sorted(found) != sorted(expected):
        raise InputError(
            f"PerClipGuide: the model has the latent sites {', '.join(found)}; "
            f"it must have {' and '.join(expected)} alone."
        )


def _sites_of(gaussian: UnconstrainedGaussian) -> list[str]:
    return SITES if gaussian.num_components else SITES[:-1]


def _sites(autoguide: AutoGuide) -> list[str]:
    assert autoguide.prototype_trace is not None
    return [name for name, _ in autoguide.prototype_trace.iter_stochastic_nodes()]


def _sites_in_order(autoguide: Any, start: UnconstrainedGaussian) -> Tensor:
    """Indices in the autoguide's latent vector of the latents of ``start``: a model may draw its sites in any order."""
    sites = _sites(autoguide)
    sizes = dict(zip(SITES, (start.num_weights, start.num_sources - 1, start.num_diffuse), strict=True))
    index = dict(zip(sites, torch.arange(autoguide.latent_dim).split([sizes[site] for site in sites]), strict=True))
    return torch.cat([index[site] for site in _sites_of(start)])

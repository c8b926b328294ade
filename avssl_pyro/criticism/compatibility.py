"""Combinations of model, guide and ELBO estimator, with checks of their compatibility."""

from dataclasses import dataclass
from typing import Any

import pyro
import torch
from pyro.infer import ELBO, RenyiELBO, Trace_ELBO, TraceEnum_ELBO
from torch import Tensor, nn

from avssl_pyro.errors import InputError
from avssl_pyro.models.explicit_masks import ExplicitMaskCGMM
from avssl_pyro.models.spatial_cgmm import SpatialCGMM


def sampled_elbo(draws: int) -> ELBO:
    """Trace_ELBO averaged over ``draws`` vectorised draws of the guide."""
    return Trace_ELBO(num_particles=draws, vectorize_particles=True, max_plate_nesting=1)


@dataclass(frozen=True)
class Combination:
    """A model, a guide and one of Pyro's estimators of the ELBO.

    Args:
        model: :class:`SpatialCGMM` or :class:`ExplicitMaskCGMM` with any priors and any likelihood.
        guide: guide of the sites ``direction_weights``, ``mixing_levels`` and, with a room, ``diffuse_weights``.
        estimator: ``Trace_ELBO()``, ``TraceMeanField_ELBO()`` (sampled where torch has no KL), ``TraceEnum_ELBO()``
            (for explicit masks) or ``RenyiELBO()`` (to evaluate).

    Raises:
        InputError: the three are incompatible; the message gives the reason and an alternative.
    """

    model: SpatialCGMM
    guide: Any
    estimator: ELBO

    def __post_init__(self) -> None:
        if not isinstance(self.model, SpatialCGMM):
            raise InputError(
                f"Combination: {type(self.model).__name__} is no SpatialCGMM; the order is model, guide, estimator."
            )
        if not isinstance(self.estimator, ELBO):
            raise InputError(f"Combination: {self.estimator} is no estimator; give an object such as Trace_ELBO().")
        estimator = type(self.estimator).__name__
        if isinstance(self.model, ExplicitMaskCGMM) and not isinstance(self.estimator, TraceEnum_ELBO):
            raise InputError(
                f"ExplicitMaskCGMM has a discrete mask in every bin, which {estimator} would draw; use TraceEnum_ELBO, "
                "which sums over it, or SpatialCGMM, in which it is summed out."
            )
        if isinstance(self.estimator, TraceEnum_ELBO) and not isinstance(self.model, ExplicitMaskCGMM):
            raise InputError(
                f"TraceEnum_ELBO has nothing to sum over in {type(self.model).__name__}, whose masks are summed out "
                "already; use Trace_ELBO, which is the same here, or ExplicitMaskCGMM."
            )
        if isinstance(self.estimator, RenyiELBO) and self.model.bin_weight != 1:
            raise InputError(
                "RenyiELBO is no bound where sites are scaled, and every bin of this model counts "
                f"{self.model.bin_weight:g} times; use Trace_ELBO, or a model with bin_weight=1."
            )
        classes = getattr(self.guide, "num_sources", self.model.num_sources)
        if classes != self.model.num_sources:
            raise InputError(
                f"the guide has {classes} source classes and the model {self.model.num_sources}; give both the same."
            )
        components = self.model.num_diffuse
        found = getattr(self.guide, "num_diffuse", components)
        if found != components:
            raise InputError(
                f"the guide has {found} diffuse components and the model {components}; give both the same."
            )

    def trainable_loss(self) -> nn.Module:
        """The negative ELBO, summed over clips, as a torch module with the parameters that can be trained.

        Raises:
            InputError: nothing can be trained.
        """
        if isinstance(self.estimator, RenyiELBO):
            raise InputError("RenyiELBO gives no loss to differentiate; train with Trace_ELBO, and evaluate with it.")
        if getattr(self.guide, "fits_each_clip", False):
            raise InputError(
                f"{type(self.guide).__name__} fits every clip by itself and has nothing to train; train the guide that "
                "it starts from."
            )
        module: nn.Module = self.estimator(self.model, self.guide)
        return module

    def elbo(self, x_bfmt: Tensor, image_bcij: Tensor) -> float:
        """An estimate of the ELBO, or of Renyi's bound, summed over the clips, nats."""
        # Pyro's global store would keep new parameters, and a later SVI would train them instead.
        store = pyro.get_param_store()
        with torch.no_grad(), store.scope(store.get_state()):
            estimator: Any = self.estimator
            return -float(estimator.loss(self.model, self.guide, x_bfmt, image_bcij))

"""MAP-EM of a model's posterior, assembled from the priors and the likelihood of the model.

Any prior or likelihood with the method needed here (``pseudo_counts``, ``of_log_weights``, ``density_generator``) can
be swapped in. For others there are guides fitted by gradients, see :mod:`avssl_pyro.guides.per_clip`.
"""

from typing import Protocol, runtime_checkable

import torch.nn.functional as F
from torch import Tensor

from avssl_pyro.distributions.e_step import DensityGenerator
from avssl_pyro.distributions.log_weight_priors import LogWeightPrior
from avssl_pyro.distributions.map_em import MapEM
from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram, observe
from avssl_pyro.errors import InputError, name_of
from avssl_pyro.models.spatial_cgmm import SpatialCGMM


@runtime_checkable
class CountedLevels(Protocol):
    """A level prior that adds counts to those of the clip: a Dirichlet distribution."""

    def pseudo_counts(self, num_sources: int, like: Tensor) -> Tensor:
        """Counts of every class before any observation, (K,)."""
        ...


@runtime_checkable
class SmoothWeights(Protocol):
    """A direction prior whose gradient over log w is known."""

    def of_log_weights(self, num_directions: int, like: Tensor) -> LogWeightPrior:
        """The prior over log w."""
        ...


@runtime_checkable
class HasDensityGenerator(Protocol):
    """A likelihood whose density is a power of x^H H^-1 x plus an offset."""

    def density_generator(self, observed: ObservedSpectrogram) -> DensityGenerator:
        """Power and offset."""
        ...


@runtime_checkable
class WeighsBins(Protocol):
    """A likelihood in which some time-frequency bins count more than others."""

    def bin_weights(self, observed: ObservedSpectrogram) -> Tensor:
        """Weights of the bins of a whole spectrogram, (B, F, T)."""
        ...


def check_map_em(model: SpatialCGMM) -> None:
    """Refuses a model whose posterior MAP-EM cannot maximise.

    Raises:
        InputError: a prior or the likelihood lacks the method that MAP-EM needs.
    """
    for role, part, protocol, method in (
        ("level prior", model.level_prior, CountedLevels, "pseudo_counts"),
        ("direction prior", model.direction_prior, SmoothWeights, "of_log_weights"),
        ("likelihood", model.likelihood, HasDensityGenerator, "density_generator"),
    ):
        if not isinstance(part, protocol):
            raise InputError(
                f"the {role} {name_of(part)} has no '{method}', which closed-form refinement needs; add that method or "
                "use a PerClipGuide, which needs gradients alone."
            )


def map_em_of(
    model: SpatialCGMM,
    x_bfmt: Tensor,
    like_bkd: Tensor,
    *,
    bin_step: int = 1,
    frame_step: int = 1,
    prior_mean: Tensor | float = 0.0,
) -> MapEM:
    """MAP-EM of p(w, pi | x) for a batch of clips; with a room, its diffuse weights follow those of directions.

    Args:
        model: model that passed :func:`check_map_em`.
        x_bfmt: spectrograms, complex (B, F, M, T).
        like_bkd: tensor with dtype, device and shape of the log direction weights.
        bin_step, frame_step: strides over frequencies and frames; those used stand for the others.
        prior_mean: mean of log w, as of :class:`MapEM`.
    """
    levels, directions, likelihood = model.level_prior, model.direction_prior, model.likelihood
    assert isinstance(levels, CountedLevels)
    assert isinstance(directions, SmoothWeights)
    assert isinstance(likelihood, HasDensityGenerator)
    _, num_sources, num_directions = like_bkd.shape
    observed = observe(x_bfmt[:, ::bin_step, :, ::frame_step])
    weight_bft = None
    if isinstance(likelihood, WeighsBins):
        # Of the whole spectrogram: what went before a frame is known from all of them.
        weight_bft = likelihood.bin_weights(observe(x_bfmt))[:, ::bin_step, ::frame_step]
    prior = directions.of_log_weights(num_directions, like_bkd)
    if model.room is not None:
        prior = model.room.with_directions(prior)
        if isinstance(prior_mean, Tensor):
            prior_mean = F.pad(prior_mean, (0, model.room.num_components))
    _, bins, _, t = observed.features_bfct.shape
    return MapEM(
        observed,
        model.template_dfmm[:, ::bin_step],
        model.diffuse,
        likelihood.density_generator(observed),
        prior,
        levels.pseudo_counts(num_sources, like_bkd),
        weight=model.bin_weight * x_bfmt.shape[1] * x_bfmt.shape[-1] / (bins * t),
        prior_mean=prior_mean,
        bin_weight_bft=weight_bft,
    )

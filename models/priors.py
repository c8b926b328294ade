"""Priors of the spatial mixture: small objects that return a distribution, made to be swapped."""

from dataclasses import dataclass
from typing import Protocol

import pyro.distributions as dist
from pyro.distributions import TorchDistribution
from torch import Tensor


class LevelPrior(Protocol):
    """A prior of the mixing levels pi."""

    def __call__(self, num_sources: int, like: Tensor) -> TorchDistribution:
        """A distribution over the simplex, event_shape (K,), with dtype and device of ``like``."""
        ...


class DirectionPrior(Protocol):
    """A prior of the direction weights w."""

    def __call__(self, num_sources: int, num_directions: int, like: Tensor) -> TorchDistribution:
        """A distribution over positive weights, event_shape (K, D), with dtype and device of ``like``."""
        ...


@dataclass(frozen=True)
class SparseDirichlet:
    """pi ~ Dir(alpha, ..., alpha); alpha < 1 shrinks source classes that are not needed (Sec. III-C)."""

    alpha: float = 0.01

    def __call__(self, num_sources: int, like: Tensor) -> TorchDistribution:
        return dist.Dirichlet(like.new_full((num_sources,), self.alpha))


@dataclass(frozen=True)
class LogNormalWeights:
    """w_kd ~ LogNormal(0, sigma^2), which keeps weights from taking exceedingly large values (Eq. 11)."""

    sigma: float = 1.0

    def __call__(self, num_sources: int, num_directions: int, like: Tensor) -> TorchDistribution:
        zero = like.new_zeros(num_sources, num_directions)
        return dist.LogNormal(zero, like.new_full((), self.sigma)).to_event(2)

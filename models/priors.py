"""Priors of the spatial mixture: small, exchangeable objects that return a distribution.

MAP-EM also needs ``pseudo_counts`` of a level prior and ``of_log_weights`` of a direction prior; a prior without them
goes with guides that are fitted by gradients.
"""

import math
from typing import Protocol

import pyro.distributions as dist
import torch
from attrs import field, frozen
from pyro.distributions import TorchDistribution
from torch import Tensor
from torch.distributions import constraints
from torch.distributions.transforms import ExpTransform

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.distributions.log_weight_priors import (
    CorrelatedLogWeights,
    GammaLogWeights,
    HalfNormalLogWeights,
    LogWeightPrior,
    MixedLogWeights,
    NormalLogWeights,
)
from avssl_pyro.distributions.simplex import AdditiveLogRatio, TruncatedStickBreaking
from avssl_pyro.validators import between, positive, within


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


@frozen
class SymmetricDirichlet:
    """pi ~ Dir(alpha, ..., alpha); alpha = 1 is uniform over the simplex."""

    alpha: float = field(default=1.0, validator=positive)

    def __call__(self, num_sources: int, like: Tensor) -> TorchDistribution:
        return dist.Dirichlet(self.pseudo_counts(num_sources, like))

    def pseudo_counts(self, num_sources: int, like: Tensor) -> Tensor:
        """Time-frequency bins of every class before any observation, (K,)."""
        return like.new_full((num_sources,), self.alpha)


@frozen
class SparseDirichlet(SymmetricDirichlet):
    """pi ~ Dir(alpha, ..., alpha); alpha < 1 shrinks source classes that are not needed (Sec. III-C).

    >>> SparseDirichlet(0.01)(num_sources=4, like=torch.zeros(())).event_shape
    torch.Size([4])
    """

    alpha: float = field(default=0.01, validator=positive)


@frozen
class StickBreaking:
    """A Dirichlet process cut off after K classes (Sethuraman 1994): the first classes are the loudest.

    Args:
        concentration: concentration of the process; the smaller, the fewer classes share the power.
    """

    concentration: float = field(default=1.0, validator=positive)

    def __call__(self, num_sources: int, like: Tensor) -> TorchDistribution:
        return TruncatedStickBreaking(like.new_tensor(self.concentration), num_sources)


@frozen
class LogisticNormal:
    """pi = softmax(z) with z_k ~ N(0, sigma^2) (Aitchison 1986); levels are never quite 0."""

    sigma: float = field(default=1.0, validator=positive)

    def __call__(self, num_sources: int, like: Tensor) -> TorchDistribution:
        if num_sources == 1:
            return dist.Dirichlet(like.new_ones(1))
        # Of z_k - z_K, which all classes but the last have; they share the last one's part.
        ratios = num_sources - 1
        covariance = self.sigma**2 * (torch.eye(ratios, dtype=like.dtype, device=like.device) + 1)
        normal = dist.MultivariateNormal(like.new_zeros(ratios), covariance_matrix=covariance)
        return dist.TransformedDistribution(normal, [AdditiveLogRatio()])


@frozen
class LogNormalWeights:
    """w_kd ~ LogNormal(0, sigma^2), which keeps weights from taking exceedingly large values (Eq. 11).

    >>> LogNormalWeights(1.0)(num_sources=4, num_directions=72, like=torch.zeros(())).event_shape
    torch.Size([4, 72])
    """

    sigma: float = field(default=1.0, validator=positive)

    def __call__(self, num_sources: int, num_directions: int, like: Tensor) -> TorchDistribution:
        zero = like.new_zeros(num_sources, num_directions)
        return dist.LogNormal(zero, like.new_full((), self.sigma)).to_event(2)

    def of_log_weights(self, num_directions: int, like: Tensor) -> LogWeightPrior:  # noqa: ARG002
        """This prior as one over log w."""
        return NormalLogWeights(self.sigma)


@frozen
class GammaWeights:
    """w_kd ~ Gamma(shape, rate = shape), of mean 1; a small shape makes most directions silent."""

    shape: float = field(default=1.0, validator=positive)

    def __call__(self, num_sources: int, num_directions: int, like: Tensor) -> TorchDistribution:
        shape_kd = like.new_full((num_sources, num_directions), self.shape)
        return dist.Gamma(shape_kd, shape_kd).to_event(2)

    def of_log_weights(self, num_directions: int, like: Tensor) -> LogWeightPrior:  # noqa: ARG002
        """This prior as one over log w."""
        return GammaLogWeights(self.shape)


@frozen
class HalfNormalWeights:
    """``w_kd = |v|`` with v ~ N(0, sigma^2): no direction stands out far, any may be silent."""

    sigma: float = field(default=1.0, validator=positive)

    def __call__(self, num_sources: int, num_directions: int, like: Tensor) -> TorchDistribution:
        return dist.HalfNormal(like.new_full((num_sources, num_directions), self.sigma)).to_event(2)

    def of_log_weights(self, num_directions: int, like: Tensor) -> LogWeightPrior:  # noqa: ARG002
        """This prior as one over log w."""
        return HalfNormalLogWeights(self.sigma)


class _PositiveMixture(dist.MixtureSameFamily):
    """A mixture of log-normals whose support autoguides recognise as positive."""

    support = constraints.positive


@frozen
class SpikeAndSlabWeights:
    """log w_kd ~ share N(0, sigma^2) + (1 - share) N(-depth, sigma^2): a class covers few directions.

    Args:
        share: share of the directions that a class covers.
        depth: distance of the other directions below them, in units of log w.
        sigma: standard deviation of both components.
    """

    share: float = field(default=0.1, validator=between(0, 1))
    depth: float = field(default=4.0, validator=positive)
    sigma: float = field(default=1.0, validator=positive)

    def __call__(self, num_sources: int, num_directions: int, like: Tensor) -> TorchDistribution:
        part_kdj, mean_kdj = (part_j.expand(num_sources, num_directions, 2) for part_j in self._components(like))
        components = dist.LogNormal(mean_kdj, like.new_tensor(self.sigma))
        return _PositiveMixture(dist.Categorical(part_kdj), components).to_event(2)

    def of_log_weights(self, num_directions: int, like: Tensor) -> LogWeightPrior:  # noqa: ARG002
        """This prior as one over log w."""
        share_j, mean_j = self._components(like)
        return MixedLogWeights(share_j.log(), mean_j, self.sigma)

    def _components(self, like: Tensor) -> tuple[Tensor, Tensor]:
        return like.new_tensor([self.share, 1 - self.share]), like.new_tensor([0.0, -self.depth])


@frozen
class CircularWeights:
    """log w_k ~ a Gaussian process around the circle, with correlated neighbours.

    Two directions at an angle have covariance sigma^2 ((1 - rough) exp((cos(angle) - 1) / width^2) + rough [same]).

    Args:
        sigma: standard deviation of every log-weight.
        width_deg: correlation length, degrees.
        rough: share of the variance that is independent between neighbours.
    """

    sigma: float = field(default=1.0, validator=positive)
    width_deg: float = field(default=15.0, validator=positive)
    # Without roughness a wide process has a covariance that is singular in float32.
    rough: float = field(default=0.1, validator=within(1e-3, 1))

    def __call__(self, num_sources: int, num_directions: int, like: Tensor) -> TorchDistribution:
        zero_kd = like.new_zeros(num_sources, num_directions)
        process = dist.MultivariateNormal(zero_kd, covariance_matrix=self.covariance(num_directions, like))
        return dist.TransformedDistribution(process.to_event(1), [ExpTransform()])

    def covariance(self, num_directions: int, like: Tensor) -> Tensor:
        """Covariance of the log-weights of a class, (D, D)."""
        azimuth_d = torch.from_numpy(DirectionGrid(num_directions).azimuths)
        closeness_dd = (azimuth_d[:, None] - azimuth_d).cos() - 1
        smooth_dd = torch.exp(closeness_dd / math.radians(self.width_deg) ** 2)
        same_dd = torch.eye(num_directions, dtype=torch.float64)
        return (self.sigma**2 * ((1 - self.rough) * smooth_dd + self.rough * same_dd)).to(like)

    def of_log_weights(self, num_directions: int, like: Tensor) -> LogWeightPrior:
        """This prior as one over log w."""
        covariance_dd = self.covariance(num_directions, like.new_zeros((), dtype=torch.float64))
        return CorrelatedLogWeights(torch.linalg.inv(covariance_dd).to(like))

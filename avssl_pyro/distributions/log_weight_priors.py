"""Priors of log direction weights with the gradient and curvature that MAP-EM needs.

Densities are over log w and include the Jacobian, because the best guide that is normal in log w has its mean near
the mode of that density. Classes are independent; all tensors broadcast against (B, K, D).
"""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor


class LogWeightPrior(Protocol):
    """Interface of a prior of log w to MAP-EM."""

    def log_density(self, log_w_bkd: Tensor) -> Tensor:
        """log p summed over classes and directions, up to a constant, (B,)."""
        ...

    def gradient(self, log_w_bkd: Tensor) -> Tensor:
        """d log p / d log w, (B, K, D)."""
        ...

    def precision(self, log_w_bkd: Tensor, variance_bkd: Tensor | float = 0.0) -> Tensor:
        """Diagonal of a curvature that bounds -log p from above around log w, not negative, (B, K, D).

        Args:
            log_w_bkd: point of evaluation.
            variance_bkd: variance of a normal distribution about log w over which the mean is taken.
        """
        ...

    def newton_step(self, gradient_bkd: Tensor, curvature_bkd: Tensor, log_w_bkd: Tensor) -> Tensor:
        """Newton step of the sum of this prior and a function with the given diagonal curvature, (B, K, D).

        Args:
            gradient_bkd: gradient of the sum.
            curvature_bkd: curvature of the other function alone, positive.
            log_w_bkd: point of evaluation.
        """
        ...

    def shift(self, log_w_bkd: Tensor) -> Tensor:
        """Shift of all log-weights of a class to the scale of greatest prior density, (B, K, 1).

        The likelihood does not depend on it.
        """
        ...


class _Independent:
    """Base of priors with independent directions, for which a Newton step is a division."""

    def precision(self, log_w_bkd: Tensor, variance_bkd: Tensor | float = 0.0) -> Tensor:
        raise NotImplementedError

    def newton_step(self, gradient_bkd: Tensor, curvature_bkd: Tensor, log_w_bkd: Tensor) -> Tensor:
        return gradient_bkd / (curvature_bkd + self.precision(log_w_bkd))


@dataclass(frozen=True)
class NormalLogWeights(_Independent):
    """log w ~ N(mean, sigma^2), Eq. (11) with a mean of 0.

    Args:
        sigma: standard deviation of every log-weight.
        mean: mean of log w, a number or broadcast against (B, K, D).
    """

    sigma: float = 1.0
    mean: Tensor | float = 0.0

    def log_density(self, log_w_bkd: Tensor) -> Tensor:
        return -0.5 * ((log_w_bkd - self.mean) / self.sigma).square().sum((-2, -1))

    def gradient(self, log_w_bkd: Tensor) -> Tensor:
        return (self.mean - log_w_bkd) / self.sigma**2

    def precision(self, log_w_bkd: Tensor, variance_bkd: Tensor | float = 0.0) -> Tensor:  # noqa: ARG002
        return torch.full_like(log_w_bkd, self.sigma**-2)

    def shift(self, log_w_bkd: Tensor) -> Tensor:
        return (self.mean - log_w_bkd).mean(-1, keepdim=True)


@dataclass(frozen=True)
class GammaLogWeights(_Independent):
    """w ~ Gamma(shape, rate = shape)."""

    shape: float = 1.0

    def log_density(self, log_w_bkd: Tensor) -> Tensor:
        return self.shape * (log_w_bkd - log_w_bkd.exp()).sum((-2, -1))

    def gradient(self, log_w_bkd: Tensor) -> Tensor:
        return self.shape * (1 - log_w_bkd.exp())

    def precision(self, log_w_bkd: Tensor, variance_bkd: Tensor | float = 0.0) -> Tensor:
        return self.shape * (log_w_bkd + variance_bkd / 2).exp()

    def shift(self, log_w_bkd: Tensor) -> Tensor:
        return -_log_mean_exp(log_w_bkd)


@dataclass(frozen=True)
class HalfNormalLogWeights(_Independent):
    """``w = |v|`` with v ~ N(0, sigma^2)."""

    sigma: float = 1.0

    def log_density(self, log_w_bkd: Tensor) -> Tensor:
        return (log_w_bkd - 0.5 * (2 * log_w_bkd).exp() / self.sigma**2).sum((-2, -1))

    def gradient(self, log_w_bkd: Tensor) -> Tensor:
        return 1 - (2 * log_w_bkd).exp() / self.sigma**2

    def precision(self, log_w_bkd: Tensor, variance_bkd: Tensor | float = 0.0) -> Tensor:
        return 2 * (2 * (log_w_bkd + variance_bkd)).exp() / self.sigma**2

    def shift(self, log_w_bkd: Tensor) -> Tensor:
        return 0.5 * (2 * log_w_bkd.new_tensor(self.sigma).log() - _log_mean_exp(2 * log_w_bkd))


@dataclass(frozen=True)
class MixedLogWeights(_Independent):
    """log w ~ sum_j share_j N(mean_j, sigma^2); bounded by EM at the current responsibilities.

    Between the components the density is flatter than the bound, and spreads made with it are too small there.

    Args:
        log_share_j, mean_j: log shares and means of the components, (J,).
        sigma: standard deviation of all components.
    """

    log_share_j: Tensor
    mean_j: Tensor
    sigma: float

    def _log_parts(self, log_w_bkd: Tensor) -> Tensor:
        return self.log_share_j - 0.5 * ((log_w_bkd[..., None] - self.mean_j) / self.sigma).square()

    def _expected_mean(self, log_w_bkd: Tensor) -> Tensor:
        return self._log_parts(log_w_bkd).softmax(-1) @ self.mean_j

    def log_density(self, log_w_bkd: Tensor) -> Tensor:
        return self._log_parts(log_w_bkd).logsumexp(-1).sum((-2, -1))

    def gradient(self, log_w_bkd: Tensor) -> Tensor:
        return (self._expected_mean(log_w_bkd) - log_w_bkd) / self.sigma**2

    def precision(self, log_w_bkd: Tensor, variance_bkd: Tensor | float = 0.0) -> Tensor:  # noqa: ARG002
        return torch.full_like(log_w_bkd, self.sigma**-2)

    def shift(self, log_w_bkd: Tensor) -> Tensor:
        return (self._expected_mean(log_w_bkd) - log_w_bkd).mean(-1, keepdim=True)


@dataclass(frozen=True)
class CorrelatedLogWeights:
    """log w ~ N(0, C) with a covariance over directions that is the same all around the circle.

    Args:
        precision_dd: C^-1, (D, D), circulant.
    """

    precision_dd: Tensor

    def log_density(self, log_w_bkd: Tensor) -> Tensor:
        return -0.5 * (log_w_bkd @ self.precision_dd * log_w_bkd).sum((-2, -1))

    def gradient(self, log_w_bkd: Tensor) -> Tensor:
        return -log_w_bkd @ self.precision_dd

    def precision(self, log_w_bkd: Tensor, variance_bkd: Tensor | float = 0.0) -> Tensor:  # noqa: ARG002
        return self.precision_dd.diagonal().expand_as(log_w_bkd)

    def newton_step(self, gradient_bkd: Tensor, curvature_bkd: Tensor, log_w_bkd: Tensor) -> Tensor:  # noqa: ARG002
        factor_bkdd = torch.linalg.cholesky(torch.diag_embed(curvature_bkd) + self.precision_dd)
        return torch.cholesky_solve(gradient_bkd[..., None], factor_bkdd).squeeze(-1)

    def shift(self, log_w_bkd: Tensor) -> Tensor:
        # A constant is an eigenvector of every circulant matrix.
        return -log_w_bkd.mean(-1, keepdim=True)


def _log_mean_exp(value_bkd: Tensor) -> Tensor:
    return value_bkd.logsumexp(-1, keepdim=True) - torch.log(value_bkd.new_tensor(value_bkd.shape[-1]))

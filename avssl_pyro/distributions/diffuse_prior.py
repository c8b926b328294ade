"""The prior of log direction weights and log diffuse weights of a class, which share one scale."""

from dataclasses import dataclass

import torch
from torch import Tensor

from avssl_pyro.distributions.log_weight_priors import LogWeightPrior, NormalLogWeights

# Newton steps to the scale of greatest density; one is exact for normal priors.
SHIFT_STEPS = 6


@dataclass(frozen=True)
class DirectionsAndDiffuse:
    """Any prior of log w for the first D entries, log e ~ N(mean, sigma^2) for the last C.

    Args:
        directions: prior of log w.
        num_components: number of diffuse components C.
        mean, sigma: of log e.
    """

    directions: LogWeightPrior
    num_components: int
    mean: float
    sigma: float

    def _split(self, value_bkj: Tensor) -> tuple[Tensor, Tensor]:
        w_bkd, e_bkc = value_bkj.split([value_bkj.shape[-1] - self.num_components, self.num_components], dim=-1)
        return w_bkd, e_bkc

    @property
    def _diffuse(self) -> NormalLogWeights:
        return NormalLogWeights(self.sigma, self.mean)

    def log_density(self, log_w_bkd: Tensor) -> Tensor:
        w_bkd, e_bkc = self._split(log_w_bkd)
        return self.directions.log_density(w_bkd) + self._diffuse.log_density(e_bkc)

    def gradient(self, log_w_bkd: Tensor) -> Tensor:
        w_bkd, e_bkc = self._split(log_w_bkd)
        return torch.cat([self.directions.gradient(w_bkd), self._diffuse.gradient(e_bkc)], dim=-1)

    def precision(self, log_w_bkd: Tensor, variance_bkd: Tensor | float = 0.0) -> Tensor:
        w_bkd, e_bkc = self._split(log_w_bkd)
        of_w = self._split(variance_bkd)[0] if isinstance(variance_bkd, Tensor) else variance_bkd
        return torch.cat([self.directions.precision(w_bkd, of_w), self._diffuse.precision(e_bkc)], dim=-1)

    def newton_step(self, gradient_bkd: Tensor, curvature_bkd: Tensor, log_w_bkd: Tensor) -> Tensor:
        parts = zip(self._split(gradient_bkd), self._split(curvature_bkd), self._split(log_w_bkd), strict=True)
        priors = (self.directions, self._diffuse)
        return torch.cat([prior.newton_step(*part) for prior, part in zip(priors, parts, strict=True)], dim=-1)

    def shift(self, log_w_bkd: Tensor) -> Tensor:
        shift_bk1 = torch.zeros_like(log_w_bkd[..., :1])
        for _ in range(SHIFT_STEPS):
            moved_bkd = log_w_bkd + shift_bk1
            slope_bk1 = self.gradient(moved_bkd).sum(-1, keepdim=True)
            shift_bk1 = shift_bk1 + slope_bk1 / self.precision(moved_bkd).sum(-1, keepdim=True)
        return shift_bk1

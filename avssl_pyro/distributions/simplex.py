"""Distributions of mixing levels on the simplex: log-ratios and stick breaking."""

from typing import Any, ClassVar

import torch
import torch.nn.functional as F
from pyro.distributions import Beta, TorchDistribution
from torch import Size, Tensor
from torch.distributions import Transform, constraints


class AdditiveLogRatio(Transform):
    """y in R^(K-1) to pi = softmax(y_1, ..., y_(K-1), 0), a bijection onto the simplex (Aitchison 1986)."""

    domain = constraints.independent(constraints.real, 1)
    codomain = constraints.simplex
    bijective = True

    def __eq__(self, other: object) -> bool:
        return isinstance(other, AdditiveLogRatio)

    __hash__ = None  # type: ignore[assignment]

    def _call(self, x: Tensor) -> Tensor:
        return F.pad(x, (0, 1)).softmax(-1)

    def _inverse(self, y: Tensor) -> Tensor:
        log_y = y.clamp_min(torch.finfo(y.dtype).tiny).log()
        return log_y[..., :-1] - log_y[..., -1:]

    def log_abs_det_jacobian(self, x: Tensor, y: Tensor) -> Tensor:  # noqa: ARG002
        return F.pad(x, (0, 1)).log_softmax(-1).sum(-1)

    def forward_shape(self, shape: Any) -> torch.Size:
        return torch.Size([*shape[:-1], shape[-1] + 1])

    def inverse_shape(self, shape: Any) -> torch.Size:
        return torch.Size([*shape[:-1], shape[-1] - 1])


class TruncatedStickBreaking(TorchDistribution):
    """pi_k = v_k prod_j<k (1 - v_j) with v_k ~ Beta(1, concentration); the last class takes the rest.

    With the remainders r_k = sum_j>=k pi_j the density is concentration^(K-1) r_K^(concentration - 1) / prod_1<k<K r_k.

    Args:
        concentration: positive concentration, (B...); the smaller, the larger the first classes.
        num_sources: number of classes K.
    """

    arg_constraints: ClassVar[dict[str, constraints.Constraint]] = {"concentration": constraints.positive}
    support = constraints.simplex
    has_rsample = True

    def __init__(self, concentration: Tensor, num_sources: int, validate_args: bool | None = None) -> None:
        self.concentration = concentration
        super().__init__(concentration.shape, Size([num_sources]), validate_args=validate_args)

    def expand(self, batch_shape: Any, _instance: Any = None) -> "TruncatedStickBreaking":
        new = self._get_checked_instance(TruncatedStickBreaking, _instance)
        new.concentration = self.concentration.expand(batch_shape)
        super(TruncatedStickBreaking, new).__init__(new.concentration.shape, self.event_shape, validate_args=False)
        new._validate_args = self.__dict__.get("_validate_args")
        return new

    def log_prob(self, value: Tensor) -> Tensor:
        if self._validate_args:
            self._validate_sample(value)
        tiny = torch.finfo(value.dtype).tiny
        # Summed from the end, where the remainders are small: 1 - sum of the others would be all rounding.
        log_rest_bk = value.flip(-1).cumsum(-1).flip(-1).clamp_min(tiny).log()
        sticks = value.shape[-1] - 1
        log_density = sticks * self.concentration.log() - log_rest_bk[..., 1:-1].sum(-1)
        return log_density + (self.concentration - 1) * log_rest_bk[..., -1] if sticks else log_density

    def rsample(self, sample_shape: Any = ()) -> Tensor:
        sticks = self.event_shape[0] - 1
        one = torch.ones_like(self.concentration)
        v_bk = Beta(one, self.concentration).expand([sticks, *self.batch_shape]).rsample(Size(sample_shape))
        v_bk = v_bk.movedim(len(Size(sample_shape)), -1)
        whole = v_bk.new_ones(*v_bk.shape[:-1], 1)
        left_bk = torch.cat([whole, (1 - v_bk).cumprod(-1)], -1)
        return torch.cat([v_bk, whole], -1) * left_bk

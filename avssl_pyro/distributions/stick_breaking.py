"""Levels broken off a stick one after another: a Dirichlet process cut off after K classes."""

from typing import Any, ClassVar

import torch
from pyro.distributions import Beta, TorchDistribution
from torch import Size, Tensor
from torch.distributions import constraints


class TruncatedStickBreaking(TorchDistribution):
    """pi_k = v_k prod_j<k (1 - v_j) with v_k ~ Beta(1, concentration); the last class takes what is left.

    With the remainders r_k = sum_j>=k pi_j the density is concentration^(K-1) r_K^(concentration - 1) / prod_1<k<K r_k.

    Args:
        concentration: positive, (B...); the smaller, the sooner the stick is used up.
        num_sources: K.
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

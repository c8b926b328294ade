"""Levels as log-ratios to the last one, which turns a normal distribution into a logistic-normal one."""

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor
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

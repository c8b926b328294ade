"""Augmentation of 360-degree images by random yaw and mirroring."""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class RandomYawFlip:
    """Yaw by whole directions and optional mirroring of each clip.

    Args:
        num_directions: number of directions D.
        turn_b1: yaw in directions, integers, (B, 1).
        sign_b1: sign of the azimuth, -1 for a mirrored view, (B, 1).
    """

    num_directions: int
    turn_b1: Tensor
    sign_b1: Tensor

    @classmethod
    def draw(cls, num_clips: int, num_directions: int, device: torch.device) -> "RandomYawFlip":
        """Draws yaw and mirroring of ``num_clips`` clips from torch's global generator."""
        turn_b1 = torch.randint(num_directions, (num_clips, 1), device=device)
        sign_b1 = 1 - 2 * torch.randint(2, (num_clips, 1), device=device)
        return cls(num_directions, turn_b1, sign_b1)

    def apply(self, x: Tensor) -> Tensor:
        """Returns ``x`` turned and mirrored.

        Args:
            x: tensor whose last axis covers the circle, (B, ..., J); J is a multiple of D.
        """
        return x.gather(-1, self._source_columns(x))

    def undo(self, x: Tensor) -> Tensor:
        """Inverts :meth:`apply`."""
        return torch.empty_like(x).scatter(-1, self._source_columns(x), x)

    def _source_columns(self, x: Tensor) -> Tensor:
        columns = x.shape[-1]
        j = torch.arange(columns, device=x.device)
        turn_b1 = self.turn_b1 * (columns // self.num_directions)
        # Mirrored, column 0 is taken from column -1, because the edge of the image lies between columns.
        source_bj = (self.sign_b1 * j + turn_b1 - (self.sign_b1 < 0).long()) % columns
        return source_bj.reshape(-1, *(1,) * (x.dim() - 2), columns).expand_as(x)

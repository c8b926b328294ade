"""Visual network, a U-Net from a 360-degree image to log-weights (Fig. 3 a)."""

import math
from collections.abc import Sequence
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from avssl_pyro.networks.augmentation import RandomYawFlip


class _WrapAzimuth(torch.autograd.Function):
    """Circular padding by one column, with one copy in backward; F.pad makes three."""

    @staticmethod
    def forward(_ctx: Any, x: Tensor) -> Tensor:
        return torch.cat([x[..., -1:], x, x[..., :1]], dim=-1)

    @staticmethod
    def backward(_ctx: Any, *grads: Tensor) -> Tensor:
        (grad,) = grads
        inner = grad[..., 1:-1].clone(memory_format=torch.contiguous_format)
        inner[..., -1] += grad[..., 0]
        inner[..., 0] += grad[..., -1]
        return inner


class AzimuthConv(nn.Module):
    """3x3 convolution with circular or zero padding along azimuth.

    Padding along elevation is always zero.

    Args:
        inputs, outputs: numbers of channels.
        stride: stride in pixels.
        circular: flag for circular padding along azimuth.
    """

    def __init__(self, inputs: int, outputs: int, stride: int = 1, circular: bool = False) -> None:
        super().__init__()
        self.circular = circular
        padding = (1, 0) if circular else (1, 1)
        self.conv = nn.Conv2d(inputs, outputs, kernel_size=3, stride=stride, padding=padding, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        padded: Tensor = _WrapAzimuth.apply(x) if self.circular else x
        convolved: Tensor = self.conv(padded)
        return convolved


def _block(inputs: int, outputs: int, stride: int, circular: bool) -> nn.Sequential:
    return nn.Sequential(
        AzimuthConv(inputs, outputs, stride, circular), nn.BatchNorm2d(outputs), nn.LeakyReLU(0.1, inplace=True)
    )


class _Up(nn.Module):
    """Doubles the resolution with a pixel shuffle and adds the skip connection."""

    def __init__(self, inputs: int, outputs: int, circular: bool) -> None:
        super().__init__()
        self.expand = nn.Conv2d(inputs, 4 * outputs, kernel_size=1)
        self.shuffle = nn.PixelShuffle(2)
        self.merge = _block(outputs, outputs, 1, circular)

    def forward(self, x: Tensor, skip: Tensor) -> Tensor:
        rows, columns = skip.shape[-2:]
        merged: Tensor = self.merge(self.shuffle(self.expand(x))[..., :rows, :columns] + skip)
        return merged


class VisualNet(nn.Module):
    """Visual network of Fig. 3 (a), which estimates log-weights over directions.

    The stages are a U-Net, 1x1 convolutions, a resize to D columns and vertical max pooling. The decoder ends at a
    quarter of the image's resolution, which is one column per direction of the usual grid.

    Args:
        num_sources: number of classes K.
        num_directions: number of directions D, of which the image width is a multiple, so that columns and directions
            stay aligned.
        channels: numbers of channels of the U-Net, at least two, one for each halving of the image's resolution.
        dropout: probability of dropping a channel after the bottleneck and before the 1x1 convolutions.
        circular: flag for circular padding along azimuth, which joins the left and right edges.
        position_channels: flag that adds sine and cosine of azimuth to the inputs, so that classes can divide the
            circle. Without them and anchors, a circular network does not distinguish directions.
        anchor_gain: height of the initial anchors, learned bumps of log-weight evenly spaced over the circle, which
            give every class one sector; 0 for none.
        augment: flag for random yaw and mirroring of each image in training, inverted on the output.
    """

    def __init__(
        self,
        num_sources: int = 4,
        num_directions: int = 72,
        channels: Sequence[int] = (16, 32, 48, 64),
        dropout: float = 0.1,
        circular: bool = True,
        position_channels: bool = True,
        anchor_gain: float = 0.0,
        augment: bool = False,
    ) -> None:
        super().__init__()
        self.num_sources = num_sources
        self.num_directions = num_directions
        self.position_channels = position_channels
        self.augment = augment
        inputs = 3 + 2 * position_channels
        self.down = nn.ModuleList()
        for depth, outputs in enumerate(channels):
            blocks = [_block(inputs, outputs, 2, circular)]
            # At the two finest levels a second convolution costs a third of the network for little.
            if depth > 1:
                blocks.append(_block(outputs, outputs, 1, circular))
            self.down.append(nn.Sequential(*blocks))
            inputs = outputs
        self.bottleneck_dropout = nn.Dropout2d(dropout)
        self.up = nn.ModuleList(
            _Up(deep, shallow, circular)
            for deep, shallow in zip(reversed(channels[2:]), reversed(channels[1:-1]), strict=True)
        )
        self.head = nn.Sequential(
            nn.Dropout2d(dropout),
            nn.Conv2d(channels[1], channels[1], kernel_size=1),
            nn.LeakyReLU(0.1, inplace=True),
            nn.Conv2d(channels[1], num_sources, kernel_size=1),
        )
        self.anchor_kd: nn.Parameter | None = None
        if anchor_gain:
            turn_d = _azimuths(num_directions) - _azimuths(num_sources)[:, None]
            self.anchor_kd = nn.Parameter(anchor_gain * turn_d.cos())

    def forward(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]:
        """Returns log-weights mu_bkd (B, K, D) and activation maps (B, K, I/4, J/4).

        Args:
            image_bcij: images with values in [0, 1], (B, 3, I, J).
        """
        if not (self.augment and self.training):
            return self._weigh(image_bcij)
        view = RandomYawFlip.draw(image_bcij.shape[0], self.num_directions, image_bcij.device)
        mu_bkd, activation_bkij = self._weigh(view.apply(image_bcij))
        return view.undo(mu_bkd), view.undo(activation_bkij)

    def _weigh(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]:
        x = 2 * image_bcij - 1
        if self.position_channels:
            x = torch.cat([x, _azimuth_planes(x)], dim=1)
        skips: list[Tensor] = []
        for level in self.down:
            x = level(x)
            skips.append(x)
        x = self.bottleneck_dropout(skips.pop())
        for level in self.up:
            x = level(x, skips.pop())
        activation_bkij: Tensor = self.head(x)
        columns_bkid = F.adaptive_avg_pool2d(activation_bkij, (activation_bkij.shape[-2], self.num_directions))
        mu_bkd = columns_bkid.amax(dim=-2)
        if self.anchor_kd is None:
            return mu_bkd, activation_bkij
        anchor_1kj = F.interpolate(self.anchor_kd[None], size=activation_bkij.shape[-1])
        return mu_bkd + self.anchor_kd, activation_bkij + anchor_1kj[:, :, None]


def _azimuths(count: int) -> Tensor:
    """Returns azimuths in radians of ``count`` equal blocks from left to right."""
    return math.pi * (1 - 2 * (torch.arange(count) + 0.5) / count)


def _azimuth_planes(x: Tensor) -> Tensor:
    b, _, rows, columns = x.shape
    azimuth_j = _azimuths(columns).to(x)
    planes = torch.stack([azimuth_j.sin(), azimuth_j.cos()])
    return planes[None, :, None, :].expand(b, 2, rows, columns)

"""Batches of clips as tensors, without labels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from avssl_pyro.clip import Clip


@dataclass(frozen=True)
class ClipBatch:
    """Stacked clips; a batch has no labels, so that training cannot use them.

    Args:
        keys: names of the B clips.
        audio_bmn: audio, float32 in [-1, 1], (B, M, N), 16 kHz.
        image_bcij: images, uint8 RGB, (B, 3, 88, 288), a quarter of the memory of :meth:`image_float`.
    """

    keys: tuple[str, ...]
    audio_bmn: Tensor
    image_bcij: Tensor

    def __len__(self) -> int:
        return len(self.keys)

    def image_float(self) -> Tensor:
        """Returns the images as float32 in [0, 1], (B, 3, 88, 288), on the batch's device."""
        return self.image_bcij.to(torch.float32) / 255.0

    def to(self, device: torch.device | str, non_blocking: bool = False) -> "ClipBatch":
        return ClipBatch(
            self.keys,
            self.audio_bmn.to(device, non_blocking=non_blocking),
            self.image_bcij.to(device, non_blocking=non_blocking),
        )

    def pin_memory(self) -> "ClipBatch":
        """Copies the batch to page-locked memory; the DataLoader calls this for accelerators."""
        return ClipBatch(self.keys, self.audio_bmn.pin_memory(), self.image_bcij.pin_memory())


def collate_clips(clips: Sequence[Clip]) -> ClipBatch:
    """Stacks clips of equal shape into a batch."""
    return ClipBatch(
        keys=tuple(clip.key for clip in clips),
        audio_bmn=torch.from_numpy(np.stack([clip.audio_mn for clip in clips])),
        image_bcij=torch.from_numpy(np.stack([clip.image_ijc.transpose(2, 0, 1) for clip in clips])),
    )

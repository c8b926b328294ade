"""Initial log-weights for refinement without a picture: broad lobes around the circle."""

import math

import torch
from torch import Tensor, nn

from avssl_pyro.acoustics.grid import DirectionGrid

# Factor of the cosine of the angle from a lobe's centre: broad, but enough to break the symmetry.
LOBE_HEIGHT = 2.0


class UninformedInitializer(nn.Module):
    """Start of :class:`avssl_pyro.guides.refined.RefinedGuide` that uses neither the picture nor the recording.

    Every class but the last covers one sector; the last covers all directions equally, for diffuse noise. A flat start
    of all classes would stay flat, because equal classes get equal updates.

    Args:
        num_sources: number of classes K, the one for diffuse noise included; a single class is a lobe.
        grid: grid of the D directions.
    """

    def __init__(self, num_sources: int, grid: DirectionGrid) -> None:
        super().__init__()
        self.num_sources = num_sources
        lobes = max(num_sources - 1, 1)
        centre_k = 2 * math.pi * torch.arange(lobes) / lobes
        azimuth_d = torch.from_numpy(grid.azimuths)
        mu_kd = torch.zeros(num_sources, grid.num_directions)
        mu_kd[:lobes] = LOBE_HEIGHT * torch.cos(azimuth_d - centre_k[:, None])
        self.mu_kd: Tensor
        self.register_buffer("mu_kd", mu_kd, persistent=False)

    def log_weights(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]:
        """The same log-weights for every clip, and flat activation maps (B, K, 1, D)."""
        mu_bkd = self.mu_kd.expand(len(image_bcij), -1, -1)
        return mu_bkd, torch.zeros_like(mu_bkd)[:, :, None]

"""Where to start refining without a picture: broad lobes around the circle, equally loud."""

import math

import torch
from torch import Tensor, nn

from avssl_pyro.acoustics.grid import DirectionGrid

# Log-weights of a lobe are this times the cosine of the angle from its centre: broad, but enough to break the symmetry.
LOBE_HEIGHT = 2.0


class UninformedInitializer(nn.Module):
    """A start of :class:`avssl_pyro.guides.refined.RefinedGuide` that knows neither the picture nor the recording.

    Every class but the last looks at a sector of its own; the last looks everywhere alike, for diffuse noise. A start
    that is flat altogether would stay flat, for equal classes are moved equally.

    Args:
        num_sources: K, source classes including the one for diffuse noise; a single class is a lobe.
        grid: the D directions.
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
        """The same log-weights for every clip; the activation maps are flat, (B, K, 1, D)."""
        mu_bkd = self.mu_kd.expand(len(image_bcij), -1, -1)
        return mu_bkd, torch.zeros_like(mu_bkd)[:, :, None]

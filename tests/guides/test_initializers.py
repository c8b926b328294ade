"""The start without a picture: it breaks the symmetry of the classes and lets refinement find talkers by ear alone."""

import numpy as np
import pytest
import torch

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.guides.initializers import UninformedInitializer
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.models.spatial_cgmm import SpatialCGMM

GRID = DirectionGrid(24)
IMAGES = torch.zeros(2, 3, 32, 48)


@pytest.mark.parametrize("num_sources", [1, 2, 5])
def test_lobes_share_the_circle_and_the_last_class_is_flat(num_sources: int) -> None:
    mu_bkd, activation_bkij = UninformedInitializer(num_sources, GRID).log_weights(IMAGES)
    assert mu_bkd.shape == (2, num_sources, 24)
    assert activation_bkij.shape == (2, num_sources, 1, 24)
    lobes = max(num_sources - 1, 1)
    peaks = GRID.azimuths[mu_bkd[0, :lobes].argmax(-1).numpy()]
    for k in range(lobes):
        assert abs(wrap_angle(peaks[k] - 2 * np.pi * k / lobes)) <= GRID.spacing / 2 + 1e-6
    if num_sources > 1:
        assert mu_bkd[0, -1].std() == 0


def test_refinement_from_there_finds_two_talkers_without_looking() -> None:
    torch.manual_seed(3)
    frequencies = np.linspace(250.0, 3500.0, 24)
    steering_fdm = FreeField(PRESETS["circle6"])(GRID, frequencies).to(torch.complex64)
    shape = (2, len(frequencies), 1, 60)
    active = (torch.rand(shape) < 0.5).float()
    signal = torch.randn(2, *shape, dtype=torch.complex64)
    first, second = (steering_fdm[:, d, :, None] for d in (4, 15))
    noise = 0.1 * torch.randn(2, len(frequencies), 6, 60, dtype=torch.complex64)
    x_bfmt = first * active * signal[0] + second * (1 - active) * signal[1] + noise
    guide = RefinedGuide(
        UninformedInitializer(5, GRID), SpatialCGMM(steering_fdm, num_sources=5), RefinementConfig(rounds=40)
    )
    found = guide.parameters_of(x_bfmt, IMAGES)
    for b in range(2):
        loud = found.concentration_bk[b].topk(2).indices
        assert sorted(found.mu_bkd[b, loud].argmax(-1).tolist()) == pytest.approx([4, 15], abs=1)
    # Nothing was said about the picture, so another one changes nothing.
    other = guide.parameters_of(x_bfmt, torch.rand_like(IMAGES))
    torch.testing.assert_close(found.mu_bkd, other.mu_bkd)

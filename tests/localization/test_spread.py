"""The spread of azimuths in closed form against draws of the log-weights."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.localization.direct_level import DirectLevelRule
from avssl_pyro.localization.posterior import ClipPosterior, peak_azimuth
from avssl_pyro.localization.spread import LARGEST, MISMATCH, azimuth_std

GRID = DirectionGrid(72)


def log_lobe(centre: float, height: float, width: float) -> torch.Tensor:
    offset_d = torch.from_numpy(np.remainder(np.arange(72) - centre + 36, 72) - 36)
    return height * torch.exp(-0.5 * (offset_d / width) ** 2)


@given(st.floats(0, 71.9), st.floats(4.0, 12.0), st.floats(1.0, 3.0))
def test_it_is_the_geometric_mean_of_the_mismatch_and_the_spread_of_drawn_peaks(
    centre: float, height: float, width: float
) -> None:
    mu_d = log_lobe(centre, height, width)
    sigma = 0.01 * height / width**2
    rng = np.random.default_rng(0)
    drawn = [
        peak_azimuth(np.exp(mu_d.numpy() + sigma * rng.standard_normal(72)), GRID)
        - peak_azimuth(np.exp(mu_d.numpy()), GRID)
        for _ in range(400)
    ]
    found = azimuth_std(mu_d[None, None], torch.full((1, 1, 72), sigma), GRID.spacing).item()
    assert found**2 / MISMATCH == pytest.approx(np.std(wrap_angle(np.array(drawn))), rel=0.3)


def test_a_flat_class_has_the_spread_of_a_uniform_distribution() -> None:
    flat = azimuth_std(torch.zeros(1, 2, 72), torch.ones(1, 2, 72), GRID.spacing)
    torch.testing.assert_close(flat, torch.full((1, 2), LARGEST))
    assert pytest.approx(math.pi / math.sqrt(3)) == LARGEST


def test_turning_the_weights_keeps_the_spread() -> None:
    mu_d = log_lobe(30.3, 5.0, 2.0)
    sigma = torch.full((1, 1, 72), 0.2, dtype=mu_d.dtype)
    spreads = [azimuth_std(mu_d.roll(turn)[None, None], sigma, GRID.spacing) for turn in (0, 41, 71)]
    torch.testing.assert_close(spreads[0], spreads[1])
    torch.testing.assert_close(spreads[0], spreads[2])


def test_the_spread_is_that_of_the_reported_peak_not_of_a_higher_single_cell() -> None:
    lobe_d = log_lobe(40.2, 6.0, 2.0)
    with_cell_d = lobe_d.clone()
    with_cell_d[10] = lobe_d.max() + 0.3
    weights_kd = with_cell_d.softmax(-1).numpy()[None]
    beliefs = ClipPosterior(weights_kd, np.ones(1), np.zeros(1), np.zeros(1))
    (source,) = DirectLevelRule(least=0.0).select(beliefs, GRID)
    assert source.azimuth_deg == pytest.approx(180 - 5 * 40.7, abs=1)
    sigma = torch.full((1, 1, 72), 0.2, dtype=lobe_d.dtype)
    sigma[..., 10] = 2.0
    expected, found = (azimuth_std(mu_d[None, None], sigma, GRID.spacing) for mu_d in (lobe_d, with_cell_d))
    torch.testing.assert_close(found, expected)

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.evaluation.peaks import PeakSetting, pick_peaks

GRID = DirectionGrid()


def bumps(*bumps_deg):
    """A spectrum with a rounded peak of a given height at each azimuth (degrees, height)."""
    spectrum_d = np.full(72, 5.0)
    for azimuth_deg, height in bumps_deg:
        spectrum_d += height * np.exp(20 * (np.cos(GRID.azimuths - np.deg2rad(azimuth_deg)) - 1))
    return spectrum_d


def test_the_strongest_peak_comes_first():
    found = pick_peaks(bumps((-60, 1.0), (90, 3.0), (0, 2.0)), GRID, PeakSetting(0.1, 4))
    assert np.rad2deg(found) == pytest.approx([90, 0, -60], abs=0.5)


def test_threshold_and_number_limit_the_peaks():
    spectrum_d = bumps((-60, 1.0), (90, 3.0), (0, 2.0))
    assert len(pick_peaks(spectrum_d, GRID, PeakSetting(0.5, 4))) == 2
    assert np.rad2deg(pick_peaks(spectrum_d, GRID, PeakSetting(0.1, 1))) == pytest.approx([90], abs=0.5)


@pytest.mark.parametrize("azimuth_deg", [180, 179, -179, 177.5, -177.5])
def test_a_peak_at_the_seam_is_one_peak(azimuth_deg):
    found = pick_peaks(bumps((azimuth_deg, 1.0)), GRID, PeakSetting(0.2, 4))
    assert len(found) == 1
    assert abs(np.rad2deg(wrap_angle(found[0] - np.deg2rad(azimuth_deg)))) < 0.5


@pytest.mark.parametrize("level", [0.0, 1.0, 1e6])
def test_a_flat_spectrum_has_no_peak_even_with_rounding_noise(level):
    spectrum_d = np.full(72, level)
    assert len(pick_peaks(spectrum_d, GRID, PeakSetting(0.05, 4))) == 0
    spectrum_d[::7] *= 1 + 1e-15
    assert len(pick_peaks(spectrum_d, GRID, PeakSetting(0.05, 4))) == 0


def test_a_plateau_is_one_peak():
    spectrum_d = np.zeros(72)
    spectrum_d[10:13] = 1.0
    assert len(pick_peaks(spectrum_d, GRID, PeakSetting(0.5, 4))) == 1


@given(st.floats(-180, 180), st.floats(0.1, 10.0))
def test_a_single_bump_is_found_anywhere(azimuth_deg, height):
    found = pick_peaks(bumps((azimuth_deg, height)), GRID, PeakSetting(0.3, 4))
    assert len(found) == 1
    assert abs(np.rad2deg(wrap_angle(found[0] - np.deg2rad(azimuth_deg)))) < 0.5

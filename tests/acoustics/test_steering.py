import numpy as np
import pytest
import torch

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.acoustics.stft import stft
from avssl_pyro.acoustics.stft_config import StftConfig


def test_shape_and_unit_modulus() -> None:
    a_fdm = FreeField(PRESETS["circle6"])(DirectionGrid(36), np.array([0.0, 500.0, 8000.0]))
    assert a_fdm.shape == (3, 36, 6)
    assert a_fdm.dtype == torch.complex128
    assert a_fdm.abs().numpy() == pytest.approx(np.ones((3, 36, 6)))
    assert (a_fdm[0] == 1).all()


def test_microphone_nearer_the_source_leads_in_phase() -> None:
    array = MicrophoneArray("pair", ((0.0, 0.1, 0.0), (0.0, -0.1, 0.0)))
    grid = DirectionGrid(360)
    left = int(grid.nearest(np.pi / 2 - 0.001))
    frequency = 100.0
    a_m = FreeField(array)(grid, np.array([frequency]))[0, left]
    assert np.angle(a_m.numpy()) == pytest.approx(2 * np.pi * frequency * np.array([0.1, -0.1]) / 343, rel=1e-3)


@pytest.mark.parametrize("index", [0, 5, 18, 31])
def test_plane_wave_through_the_stft_matches(index: int) -> None:
    """A wave built in the time domain, every microphone's copy early by p.u/c, has the predicted phases."""
    array, grid, config = PRESETS["circle4"], DirectionGrid(36), StftConfig()
    azimuth = grid.azimuths[index]
    lead_m = array.positions @ [np.cos(azimuth), np.sin(azimuth), 0.0] / array.speed_of_sound
    seconds_n = np.arange(4000) / config.sample_rate
    bin_index = 40
    frequency = config.frequencies[bin_index]
    audio_mn = np.cos(2 * np.pi * frequency * (seconds_n + lead_m[:, None]) + 0.3)
    x_mt = stft(torch.from_numpy(audio_mn)[None], config)[0, bin_index, :, 5:-5]
    expected_m = FreeField(array)(grid, np.array([frequency]))[0, index]
    ratio_mt = (x_mt / x_mt[:1]).numpy()
    assert ratio_mt == pytest.approx(
        np.repeat((expected_m / expected_m[0]).numpy()[:, None], x_mt.shape[1], 1), abs=1e-3
    )

import numpy as np
import pytest

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.spherical import sphere_response
from avssl_pyro.acoustics.steering_kinds import FreeFieldKind
from avssl_pyro.simulation.acoustics.plane_waves import PlaneWaveReceiver, PlaneWaves
from avssl_pyro.simulation.acoustics.reverberation import room_responses

SPHERE = PRESETS["starss23-mic"]
LENGTH = 4096
FREQUENCY_F = np.fft.rfftfreq(LENGTH, 1 / 16_000)
HEARD = slice(25, 1500)  # 100 to 5900 Hz


def unit(azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    azimuth, elevation = np.deg2rad((azimuth_deg, elevation_deg))
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


def spectrum(array: MicrophoneArray, waves: PlaneWaves) -> np.ndarray:
    """Spectra (M, F) without the delay of the responses."""
    receiver = PlaneWaveReceiver(array)
    delay_f = np.exp(2j * np.pi * FREQUENCY_F / 16_000 * receiver.half)
    return (np.fft.rfft(receiver.responses(waves), LENGTH) * delay_f)[:, HEARD]


@pytest.mark.parametrize(("azimuth_deg", "elevation_deg"), [(33.3, 7.1), (-141.9, -24.2)])
def test_the_direct_wave_is_heard_as_the_sphere_scatters_it(azimuth_deg: float, elevation_deg: float) -> None:
    towards = unit(azimuth_deg, elevation_deg)
    delay_s = 100.25 / 16_000
    found_mf = spectrum(SPHERE, PlaneWaves(towards[None], np.array([delay_s]), np.array([0.5])))
    wave_number_f = 2 * np.pi * FREQUENCY_F[HEARD] / SPHERE.speed_of_sound
    cosine_m = SPHERE.positions / np.linalg.norm(SPHERE.positions, axis=1, keepdims=True) @ towards
    expected_fm = 0.5 * sphere_response(wave_number_f * 0.042, cosine_m)
    expected_mf = expected_fm.T * np.exp(-2j * np.pi * FREQUENCY_F[HEARD] * delay_s)
    np.testing.assert_allclose(found_mf, expected_mf, atol=0.02)


def test_reflections_come_from_their_own_directions() -> None:
    direct, reflection = unit(0, 0), unit(120, 40)
    both = PlaneWaves(np.stack([direct, reflection]), np.array([100, 300]) / 16_000, np.array([1.0, 0.5]))
    alone = PlaneWaves(reflection[None], np.array([300]) / 16_000, np.array([0.5]))
    first = PlaneWaves(direct[None], np.array([100]) / 16_000, np.array([1.0]))
    found_mf = spectrum(SPHERE, both) - spectrum(SPHERE, first)
    expected_mf = spectrum(SPHERE, alone)
    error = np.square(np.abs(found_mf - expected_mf)).sum() / np.square(np.abs(expected_mf)).sum()
    assert error < 0.02  # of directions three degrees apart


def test_in_free_field_far_sources_are_heard_as_by_single_microphones(monkeypatch: pytest.MonkeyPatch) -> None:
    circle = PRESETS["circle4"]
    small = MicrophoneArray("small", tuple((x / 4, y / 4, z) for x, y, z in circle.positions_m))
    room = {"room_dims_m": (6.0, 6.0, 3.0), "height_m": 1.4, "room_yaw": 0.3, "rt60_s": 0.2}
    source_sx = np.array([[1.5, 1.5, 0.2]])
    points_ml = room_responses(small, source_sx, **room)[0]  # type: ignore[arg-type]
    monkeypatch.setattr(FreeFieldKind, "__eq__", lambda *_: False)
    waves_ml = room_responses(small, source_sx, **room)[0]  # type: ignore[arg-type]
    late = PlaneWaveReceiver(small).half - 20
    band = slice(50, 1000)  # 100 to 2000 Hz
    turn_f = np.exp(2j * np.pi * np.fft.rfftfreq(8192)[band] * late)
    points_mf = np.fft.rfft(points_ml, 8192)[:, band]
    waves_mf = np.fft.rfft(waves_ml, 8192)[:, band] * turn_f
    assert np.square(np.abs(waves_mf - points_mf)).sum() < 0.02 * np.square(np.abs(points_mf)).sum()


def test_a_room_is_heard_by_the_direct_wave_alone_if_asked_for() -> None:
    response_ml = room_responses(
        SPHERE,
        np.array([[0.0, 1.5, 0.0]]),
        room_dims_m=(5.0, 5.0, 3.0),
        height_m=1.4,
        room_yaw=0.0,
        rt60_s=0.3,
        max_order=0,
    )[0]
    late = PlaneWaveReceiver(SPHERE).half
    first_m = np.abs(response_ml).argmax(axis=1) - late
    assert abs(first_m.mean() - 1.5 / 343 * 16_000) < 3
    energy_m = np.square(response_ml).sum(axis=1)
    # The source is on the left, and so are the first and the third microphone.
    assert min(energy_m[[0, 2]]) > 1.3 * max(energy_m[[1, 3]])
    assert max(first_m[[0, 2]]) < min(first_m[[1, 3]])

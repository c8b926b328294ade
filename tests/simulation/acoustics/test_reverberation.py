import numpy as np
import pyroomacoustics as pra
import pytest

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.acoustics.reverberation import reverberate, room_responses, truncation_order

ROOM = (5.0, 5.0, 3.0)
PAIR = MicrophoneArray("pair", ((0.1, 0.0, 0.0), (-0.1, 0.0, 0.0)))
SOURCE = np.array([[0.9, 1.1, 0.25]])


def responses(
    array: MicrophoneArray = PAIR,
    source_sx: np.ndarray = SOURCE,
    *,
    rt60_s: float = 0.3,
    room_yaw: float = 0.7,
    max_order: int | None = None,
) -> np.ndarray:
    return room_responses(
        array, source_sx, room_dims_m=ROOM, height_m=1.35, room_yaw=room_yaw, rt60_s=rt60_s, max_order=max_order
    )


def heard(response_ml: np.ndarray) -> np.ndarray:
    impulse_n = np.zeros(12000, dtype=np.float32)
    impulse_n[0] = 1.0
    return reverberate(impulse_n, response_ml, 12000).astype(np.float64)


def test_the_direct_sound_falls_with_distance_and_arrives_in_time() -> None:
    array = PRESETS["circle246"]
    direct_ml = responses(array, max_order=0)[0]
    distance_m = np.linalg.norm(SOURCE[0] - array.positions, axis=1)
    frequency_f = np.fft.rfftfreq(4096, 1 / 16000)[50:1500]
    spectrum_mf = np.fft.rfft(direct_ml, 4096)[:, 50:1500]
    delay_m = (distance_m / 343.0 + 20 / 16000)[:, None]
    expected_mf = np.exp(-2j * np.pi * frequency_f * delay_m) / distance_m[:, None]
    np.testing.assert_allclose(spectrum_mf, expected_mf, atol=0.01)


@pytest.mark.parametrize(("rt60_s", "full_order"), [(0.2, 27), (0.3, 40)])
def test_truncation_costs_less_than_a_thousandth_of_the_energy(rt60_s: float, full_order: int) -> None:
    full_mn = heard(responses(rt60_s=rt60_s, max_order=full_order)[0])
    missing_mn = full_mn - heard(responses(rt60_s=rt60_s)[0])
    assert truncation_order(rt60_s) < full_order
    assert np.sum(missing_mn**2) / np.sum(full_mn**2) < 1e-3


def test_sound_decays_as_asked() -> None:
    for rt60_s in (0.2, 0.4):
        energy_n = np.cumsum(heard(responses(rt60_s=rt60_s)[0])[0, ::-1] ** 2)[::-1]
        level_n = 10 * np.log10(energy_n / energy_n[0])
        falling = np.flatnonzero((level_n < -5) & (level_n > -25))
        slope = np.polyfit(falling / 16000, level_n[falling], 1)[0]
        assert -60 / slope == pytest.approx(rt60_s, rel=0.3)


def test_turning_room_and_scene_together_changes_nothing() -> None:
    array = PRESETS["circle4"]
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned_ml = responses(array, SOURCE @ quarter.T, room_yaw=0.7 + np.pi / 2)[0]
    # A quarter turn to the left brings each microphone to the place of the next one.
    original_ml = responses(array)[0]
    shortest = min(turned_ml.shape[1], original_ml.shape[1])
    np.testing.assert_allclose(np.roll(turned_ml, -1, axis=0)[:, :shortest], original_ml[:, :shortest], atol=1e-4)


def test_the_bits_do_not_depend_on_the_machines_threads() -> None:
    before = pra.constants.get("num_threads")
    try:
        pra.constants.set("num_threads", 1)
        single = responses()
        pra.constants.set("num_threads", 3)
        several = responses()
        assert pra.constants.get("num_threads") == 3
    finally:
        pra.constants.set("num_threads", before)
    np.testing.assert_array_equal(single, several)


def test_reverberation_of_the_lead_sounds_into_the_clip() -> None:
    dry_n = np.zeros(3000, dtype=np.float32)
    dry_n[500] = 1.0
    response_ml = np.zeros((1, 1500), dtype=np.float32)
    response_ml[0, [0, 700, 1400]] = 1.0, 0.5, 0.25
    wet_n = reverberate(dry_n, response_ml, 2000)[0]
    assert wet_n.shape == (2000,)
    assert wet_n[200] == pytest.approx(0.5, abs=0.02)
    assert wet_n[900] == pytest.approx(0.25, abs=0.02)


def test_a_room_that_cannot_be_so_dry_is_refused() -> None:
    with pytest.raises(InputError, match=r"15\.0 x 15\.0 x 5\.0 m cannot have an RT60 of 0\.15 s"):
        room_responses(PAIR, SOURCE, room_dims_m=(15.0, 15.0, 5.0), height_m=1.3, room_yaw=0.0, rt60_s=0.15)

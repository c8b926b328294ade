import numpy as np
import numpy.typing as npt
import pyroomacoustics as pra
import pytest

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.acoustics.models import (
    ImageMethod,
    ImageMethodWithTail,
    room_model_from_dict,
)
from avssl_pyro.simulation.acoustics.reverberation import RoomAcoustics, eyring_absorption, reverberate

NUM_SAMPLES = 24_000
SOURCE_SX = np.array([[1.0, 0.3, 0.2]])
CIRCLE = PRESETS["circle4"]


def room(
    rt60_s: float = 0.4, dims_m: tuple[float, float, float] = (6.0, 5.0, 3.0), floor_m: tuple[float, float] = (2.0, 3.1)
) -> RoomAcoustics:
    return RoomAcoustics(dims_m, rt60_s, array_height_m=1.2, room_yaw=0.4, array_floor_m=floor_m)


def response(
    room: RoomAcoustics, array: MicrophoneArray = CIRCLE, *, direct_only: bool = False, seed: int = 0
) -> npt.NDArray[np.float64]:
    responses_sml = ImageMethodWithTail().responses(
        array, SOURCE_SX, room, np.random.default_rng(seed), direct_only=direct_only
    )
    impulse_n = np.zeros(NUM_SAMPLES, dtype=np.float32)
    impulse_n[0] = 1.0
    return reverberate(impulse_n, responses_sml[0], NUM_SAMPLES).astype(np.float64)


def decay_time(response_mn: npt.NDArray[np.float64]) -> float:
    energy_n = np.cumsum(np.sum(response_mn**2, axis=0)[::-1])[::-1]
    level_n = 10 * np.log10(energy_n / energy_n[0])
    falling = np.flatnonzero((level_n < -10) & (level_n > -35))
    return float(-60 / np.polyfit(falling / 16000, level_n[falling], 1)[0])


@pytest.mark.parametrize("name", ["circle4", "starss23-mic", "starss23-foa"])
@pytest.mark.parametrize("rt60_s", [0.2, 0.5, 1.0])
def test_sound_decays_as_asked(name: str, rt60_s: float) -> None:
    assert decay_time(response(room(rt60_s), PRESETS[name])) == pytest.approx(rt60_s, rel=0.1)
    assert decay_time(response(room(rt60_s, (3.0, 2.6, 2.4), (1.1, 1.4)), PRESETS[name])) == pytest.approx(
        rt60_s, rel=0.1
    )


def test_the_tail_has_the_level_of_the_reflections_that_it_replaces() -> None:
    acoustics = room(0.4)
    material = pra.Material(eyring_absorption(0.4, acoustics.dims_m))
    box = pra.ShoeBox(acoustics.dims_m, fs=16000, materials=material, max_order=40)
    box.set_sound_speed(CIRCLE.speed_of_sound)
    box.add_microphone_array((CIRCLE.positions @ acoustics.to_room.T + acoustics.array_position).T)
    box.add_source(acoustics.to_room @ SOURCE_SX[0] + acoustics.array_position)
    box.compute_rir()
    found_mn = response(acoustics)
    for first_s, last_s in ((0.02, 0.04), (0.05, 0.1), (0.1, 0.2)):
        part = slice(round(first_s * 16000), round(last_s * 16000))
        expected = sum(np.sum(box.rir[m][0][part] ** 2) for m in range(4))
        assert 10 * np.log10(np.sum(found_mn[:, part] ** 2) / expected) == pytest.approx(0.0, abs=2.0)


def test_early_reflections_are_those_of_the_image_method() -> None:
    acoustics = room(0.4)
    exact_sml = ImageMethod().responses(CIRCLE, SOURCE_SX, acoustics, np.random.default_rng(0))
    found_sml = ImageMethodWithTail().responses(CIRCLE, SOURCE_SX, acoustics, np.random.default_rng(0))
    # The two differ in absorption: Sabine's and Eyring's formula. Up to the floor there is the direct sound alone.
    np.testing.assert_allclose(found_sml[0, :, :100], exact_sml[0, :, :100], atol=0.03)
    place_m = np.abs(exact_sml[0, :, 110:500]).argmax(axis=1)
    assert (np.abs(found_sml[0, :, 110:500]).argmax(axis=1) == place_m).all()


def test_the_direct_sound_is_that_of_free_field() -> None:
    rng = np.random.default_rng(0)
    direct_mn = ImageMethodWithTail().responses(CIRCLE, SOURCE_SX, room(), rng, direct_only=True)[0]
    distance_m = np.linalg.norm(SOURCE_SX[0] - CIRCLE.positions, axis=1)
    frequency_f = np.fft.rfftfreq(4096, 1 / 16000)[50:1500]
    delay_m = (distance_m / 343.0 + 20 / 16000)[:, None]
    expected_mf = np.exp(-2j * np.pi * frequency_f * delay_m) / distance_m[:, None]
    np.testing.assert_allclose(np.fft.rfft(direct_mn, 4096)[:, 50:1500], expected_mf, atol=0.01)


def test_randomness_comes_from_the_generator_alone() -> None:
    np.testing.assert_array_equal(response(room(), seed=3), response(room(), seed=3))
    assert (response(room(), seed=3) != response(room(), seed=4)).any()


def test_any_room_and_time_have_an_absorption() -> None:
    for dims_m in ((2.5, 2.5, 2.3), (15.0, 15.0, 5.0), (15.0, 2.5, 2.3)):
        for rt60_s in (0.15, 1.0):
            assert 0.0 < eyring_absorption(rt60_s, dims_m) < 1.0


def test_a_scene_without_sources_has_no_responses() -> None:
    assert ImageMethodWithTail().responses(CIRCLE, np.zeros((0, 3)), room(), np.random.default_rng(0)).shape[:2] == (
        0,
        4,
    )


def test_models_are_read_from_manifests() -> None:
    model = ImageMethodWithTail(num_reflections=100)
    assert room_model_from_dict({"kind": "image-method-with-tail", "num_reflections": 100}) == model
    with pytest.raises(InputError, match="'waveguide'; known are"):
        room_model_from_dict({"kind": "waveguide"})
    with pytest.raises(InputError, match="num_reflections is 3"):
        ImageMethodWithTail(num_reflections=3)

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy import signal

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.acoustics.models import ROOM_MODELS, room_model_from_dict
from avssl_pyro.simulation.acoustics.ray_tracing import RayTracing
from avssl_pyro.simulation.acoustics.reverberation import RoomAcoustics
from avssl_pyro.simulation.scene_config import WIDE_SCENES, SceneConfig
from avssl_pyro.simulation.scenes import SceneSimulator

ROOM = RoomAcoustics((6.0, 5.0, 3.0), 0.5, array_height_m=1.2, room_yaw=0.4, array_floor_m=(2.0, 3.1))
SOURCE_SX = np.array([[1.0, 0.3, 0.2]])


def response(name: str = "circle4", *, direct_only: bool = False, seed: int = 0) -> npt.NDArray[np.float32]:
    rng = np.random.default_rng(seed)
    return RayTracing().responses(PRESETS[name], SOURCE_SX, ROOM, rng, direct_only=direct_only)[0]


def decay_time(response_ml: npt.NDArray[np.float32], band_hz: tuple[float, float]) -> float:
    filtered_ml = signal.sosfilt(signal.butter(3, band_hz, "band", fs=16000, output="sos"), response_ml)
    energy_l = np.cumsum(np.sum(filtered_ml.astype(np.float64) ** 2, axis=0)[::-1])[::-1]
    level_l = 10 * np.log10(energy_l / energy_l[0])
    falling = np.flatnonzero((level_l < -10) & (level_l > -30))
    return float(-60 / np.polyfit(falling / 16000, level_l[falling], 1)[0])


@pytest.mark.parametrize("name", ["circle4", "starss23-mic", "starss23-foa"])
def test_middle_tones_decay_as_asked_and_high_ones_faster(name: str) -> None:
    response_ml = response(name)
    assert decay_time(response_ml, (700, 1400)) == pytest.approx(0.5, rel=0.25)
    assert decay_time(response_ml, (4000, 6500)) < decay_time(response_ml, (150, 300))


def test_the_direct_sound_is_that_of_the_other_models() -> None:
    for name in ("circle4", "starss23-mic"):
        direct_ml = response(name, direct_only=True)
        other_ml = ROOM_MODELS["image-method-with-tail"].responses(
            PRESETS[name], SOURCE_SX, ROOM, np.random.default_rng(0), direct_only=True
        )[0]
        np.testing.assert_allclose(direct_ml, other_ml[:, : direct_ml.shape[1]], atol=1e-5)
        assert np.abs(response(name)[:, :60] - np.pad(direct_ml, ((0, 0), (0, 60)))[:, :60]).max() < 0.02


def test_early_energy_comes_from_the_sources_side() -> None:
    """Ambisonic intensity of the tail: rays arrive from the side on which the source is, at first."""
    corner = RoomAcoustics((12.0, 9.0, 4.0), 0.4, array_height_m=1.5, room_yaw=0.0, array_floor_m=(6.0, 4.5))
    source_sx = np.array([[4.5, 3.0, 0.0]])
    traced = RayTracing(image_order=0)
    wyzx_ml = traced.responses(PRESETS["starss23-foa"], source_sx, corner, np.random.default_rng(0))[0][:, 500:1100]
    x, y = np.sum(wyzx_ml[0] * wyzx_ml[3]), np.sum(wyzx_ml[0] * wyzx_ml[1])
    assert np.cos(np.arctan2(y, x) - np.arctan2(3.0, 4.5)) > 0.5


def test_the_same_generator_gives_the_same_bits() -> None:
    np.testing.assert_array_equal(response(seed=3), response(seed=3))
    assert response(seed=3).tobytes() != response(seed=4).tobytes()


def test_scenes_of_any_condition_can_be_traced() -> None:
    for config in (SceneConfig(), WIDE_SCENES):
        traced = replace(config, acoustics=RayTracing(num_rays=1000), num_samples=4000)
        assert SceneConfig.from_dict(traced.to_dict()) == traced
        scene = SceneSimulator(traced, seed=1).render(0)
        assert np.isfinite(scene.clip.audio_mn).all()
        assert scene.labels == SceneSimulator(config, seed=1).render(0).labels
    nobody_sx = np.zeros((0, 3))
    assert RayTracing().responses(PRESETS["circle4"], nobody_sx, ROOM, np.random.default_rng(0)).shape[:2] == (0, 4)


def test_settings_are_checked() -> None:
    assert room_model_from_dict({"kind": "ray-traced", "image_order": 2, "num_rays": 500}) == RayTracing(2, 500)
    with pytest.raises(InputError, match="num_rays is 5"):
        RayTracing(num_rays=5)

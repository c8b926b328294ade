"""Scenes for training: varied rooms, noise and equipment."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from joblib import Parallel, delayed

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.generation import generate
from avssl_pyro.datasets.scene_plan import plan_scenes
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.layout import draw_layout
from avssl_pyro.simulation.noise import NoiseConfig
from avssl_pyro.simulation.scene_config import SCENE_CONFIGS, WIDE_SCENES, Condition, RoomRange, SceneConfig
from avssl_pyro.simulation.scenes import SceneSimulator, SimulatedScene

NOBODY = replace(WIDE_SCENES, condition=Condition("nobody", people=(0, 2), talkers=(0,)))


def digest(scene: SimulatedScene) -> str:
    content = scene.clip.audio_mn.tobytes() + scene.clip.image_ijc.tobytes() + json.dumps(scene.metadata).encode()
    return hashlib.sha256(content).hexdigest()


def test_people_are_inside_their_ranges_and_their_room() -> None:
    counts = set()
    for seed in range(300):
        layout = draw_layout(WIDE_SCENES, np.random.default_rng(seed))
        counts.add((len(layout.people), len(layout.talkers)))
        assert layout.camera_floor_m is not None
        length, width, height = layout.room_dims_m
        assert 2.5 <= length <= 15.0 and 2.5 <= width <= 15.0 and 2.3 <= height <= 5.0
        assert 0.5 <= layout.camera_floor_m[0] <= length - 0.5 and 0.5 <= layout.camera_floor_m[1] <= width - 0.5
        assert 0.15 <= layout.rt60_s <= 1.0 and 0.3 <= layout.camera_height_m <= 2.2
        for person in layout.people:
            assert 0.5 <= person.distance_m <= 5.0
            assert abs(np.rad2deg(person.mouth_elevation)) <= 50.0 + 1e-6
            assert person.level_db is None or abs(person.level_db) <= 5.0
        inside_sx = layout.talker_positions_sx @ layout.room.to_room.T + layout.room.array_position
        assert (inside_sx > 0.29).all() and (inside_sx < np.array([length, width, height])).all()
        azimuths = np.array([person.azimuth for person in layout.people])
        apart_pq = np.abs((np.rad2deg(azimuths[:, None] - azimuths) + 180) % 360 - 180) + 360 * np.eye(len(azimuths))
        assert (apart_pq >= 15.0 - 1e-9).all()
    assert {people for people, _ in counts} == {0, 1, 2, 3, 4, 5}
    assert {talkers for _, talkers in counts} == {0, 1, 2, 3, 4}


@pytest.mark.parametrize("name", ["circle246", "respeaker4", "starss23-mic", "starss23-foa"])
def test_scenes_of_every_kind_of_array_are_reproducible(name: str) -> None:
    simulator = SceneSimulator(WIDE_SCENES, seed=4, array=PRESETS[name])
    elsewhere = Parallel(n_jobs=2)(delayed(simulator.render)(index) for index in range(4))
    assert [digest(scene) for scene in elsewhere] == [digest(simulator.render(index)) for index in range(4)]
    for scene in elsewhere:
        assert np.isfinite(scene.clip.audio_mn).all()
        assert scene.clip.audio_mn.shape == (PRESETS[name].num_microphones, 16000)
        assert 10 ** (-12.01 / 20) <= np.abs(scene.clip.audio_mn).max() <= 10 ** (-0.99 / 20)


def test_levels_noise_and_gains_are_those_of_the_metadata() -> None:
    quiet = replace(WIDE_SCENES, condition=Condition("two", (2,), (2,)), noise=NoiseConfig(num_points=(0,)))
    simulator = SceneSimulator(quiet, seed=9)
    for index in range(4):
        scene = simulator.render(index)
        talkers_smn = simulator.render_talkers(index).astype(np.float64)
        levels_db = 10 * np.log10(np.mean(talkers_smn**2, axis=(1, 2)))
        assert levels_db == pytest.approx([person.level_db for person in scene.people], abs=0.01)
        gains_db = np.array(scene.metadata["gains_db"])
        assert (np.abs(gains_db) <= 3.0).all() and np.ptp(gains_db) > 0.5
        recorded_mn = scene.clip.audio_mn / 10 ** (gains_db / 20)[:, None]
        mixture_mn = talkers_smn.sum(axis=0)
        scale = np.sum(mixture_mn * recorded_mn) / np.sum(mixture_mn**2)
        noise_mn = recorded_mn / scale - mixture_mn
        snr_db = 10 * np.log10(np.mean(mixture_mn**2) / np.mean(noise_mn**2))
        assert snr_db == pytest.approx(scene.metadata["noise"]["snr_db"], abs=0.3)
        assert 0.0 <= snr_db <= 30.5


def test_point_sources_stay_below_the_quietest_talker_and_have_no_label() -> None:
    config = replace(WIDE_SCENES, condition=Condition("two", (2,), (2,)), noise=NoiseConfig(num_points=(2,)))
    scene = SceneSimulator(config, seed=1).render(0)
    assert len(scene.metadata["noise"]["point_levels_db"]) == 2
    assert max(scene.metadata["noise"]["point_levels_db"]) <= -10.0
    assert len(scene.labels.talker_azimuths) == 2 and not scene.labels.silent_azimuths


def test_microphones_are_moved_a_little_and_the_labels_stay() -> None:
    array = PRESETS["circle246"]
    exact = SceneSimulator(replace(WIDE_SCENES, position_error_m=0.0), seed=3)
    moved = SceneSimulator(WIDE_SCENES, seed=3)
    assert exact.render(1).labels == moved.render(1).labels
    assert (exact.render(1).clip.audio_mn != moved.render(1).clip.audio_mn).any()
    offset_mx = moved._rendered_array(1).positions - array.positions
    assert 0.0 < np.abs(offset_mx).max() <= 0.003
    tetrahedron = SceneSimulator(WIDE_SCENES, array=PRESETS["starss23-mic"])
    assert tetrahedron._rendered_array(0) == tetrahedron.array


def test_scenes_without_talkers_are_stored_and_read(tmp_path: Path) -> None:
    simulator = SceneSimulator(NOBODY, seed=2)
    generate(plan_scenes(tmp_path, simulator, 4), workers=1, progress=False)
    dataset = SceneDataset(tmp_path, PRESETS["circle6"])
    for index in range(4):
        labels = dataset.labels(index)
        assert labels is not None and labels.talker_azimuths == ()
        assert len(labels.silent_azimuths) in {0, 2}
        assert np.mean(dataset[index].audio_mn ** 2) > 1e-6
        assert simulator.render_talkers(index).shape == (0, 8, 16000)


def test_configurations_survive_json_and_old_manifests_stay() -> None:
    for config in (*SCENE_CONFIGS.values(), replace(SceneConfig(), gain_range_db=(-1.0, 1.0))):
        assert SceneConfig.from_dict(json.loads(json.dumps(config.to_dict()))) == config
    assert set(SceneConfig().to_dict()) == {
        *("condition", "level_range_db", "snr_db", "rt60_range_s", "distance_range_m", "height_range_m"),
        *("min_separation_deg", "room_dims_m", "camera_height_range_m", "peak_range_db", "num_samples"),
    }


def test_impossible_settings_are_refused() -> None:
    with pytest.raises(InputError, match="wall_margin_m is 2"):
        RoomRange(wall_margin_m=2.0)
    with pytest.raises(InputError, match=r"loud_share is 1\.5"):
        NoiseConfig(loud_share=1.5)
    with pytest.raises(InputError, match="snr_range_db is"):
        NoiseConfig(snr_range_db=(30.0, 10.0))
    with pytest.raises(InputError, match="lower than the room"):
        replace(WIDE_SCENES, room=RoomRange(height_range_m=(2.0, 5.0)))
    with pytest.raises(InputError, match=r"only beyond 8\.21 m"):
        replace(WIDE_SCENES, max_elevation_deg=10.0)
    crowd = replace(WIDE_SCENES, condition=Condition("crowd", (30,), (2,)))
    with pytest.raises(InputError, match="30 people do not fit"):
        draw_layout(crowd, np.random.default_rng(0))

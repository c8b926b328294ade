"""The real simulator behind the storage: a few short scenes."""

import hashlib
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.datasets.builtin import ensure_dataset
from avssl_pyro.datasets.generation import generate
from avssl_pyro.datasets.scene_plan import asset_identity, plan_scenes
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.people import PeopleFolder
from avssl_pyro.simulation.scene_config import ALL_SPEAK, SceneConfig
from avssl_pyro.simulation.scenes import SceneSimulator

SIMULATOR = SceneSimulator(SceneConfig(num_samples=4000), seed=5)


def contents(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def test_real_scenes_are_the_same_bytes_for_any_number_of_workers(tmp_path: Path) -> None:
    generate(plan_scenes(tmp_path / "one", SIMULATOR, 5, 2), workers=1, progress=False)
    generate(plan_scenes(tmp_path / "two", SIMULATOR, 5, 2), workers=2, progress=False)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def test_real_scenes_come_back_with_their_labels(tmp_path: Path) -> None:
    dataset = ensure_dataset(plan_scenes(tmp_path, SIMULATOR, 3), workers=1, array=PRESETS["circle4"], progress=False)
    for index in range(3):
        scene, clip = SIMULATOR.render(index), dataset[index]
        np.testing.assert_allclose(clip.audio_mn, scene.clip.audio_mn[[0, 2, 4, 6]], atol=1 / 65536 + 1e-7)
        assert dataset.labels(index).talker_azimuths == pytest.approx(scene.labels.talker_azimuths, abs=1e-9)
        assert dataset.labels(index).silent_azimuths == pytest.approx(scene.labels.silent_azimuths, abs=1e-9)
        assert dataset.metadata(index) == scene.metadata


def test_a_cached_dataset_is_bound_to_its_settings(tmp_path: Path) -> None:
    ensure_dataset(plan_scenes(tmp_path, SIMULATOR, 1), workers=1, progress=False)
    other = replace(SIMULATOR, config=replace(SIMULATOR.config, condition=ALL_SPEAK))
    with pytest.raises(InputError, match=r"condition\.name = 'some-silent', not 'all-speak'"):
        ensure_dataset(plan_scenes(tmp_path, other, 1), workers=1, progress=False)


def test_material_is_known_by_its_files_not_by_its_place(tmp_path: Path) -> None:
    def folder(name: str, height: int) -> PeopleFolder:
        (tmp_path / name).mkdir()
        cv2.imwrite(str(tmp_path / name / "a.png"), np.full((height, 20, 4), 255, np.uint8))
        os.utime(tmp_path / name / "a.png", (height, height))
        return PeopleFolder(tmp_path / name)

    here, there, other = folder("here", 50), folder("there", 50), folder("other", 500)
    assert asset_identity(here) == asset_identity(there)
    assert asset_identity(here) != asset_identity(other)
    assert asset_identity(SIMULATOR.people) == {"name": "procedural"}


def test_a_relative_folder_means_the_same_to_workers_started_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        # joblib reuses its processes, which stay in the first folder.
        generate(plan_scenes(Path("scenes"), SIMULATOR, 2, scenes_per_shard=1), workers=2, progress=False)
        assert (tmp_path / name / "scenes" / "scenes-000001.tar").is_file()

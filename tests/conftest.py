"""Fixtures shared by the packages' tests: a handful of real scenes, rendered once per test process."""

from pathlib import Path

import pytest

from avssl_pyro.data.generation import generate
from avssl_pyro.data.scene_plan import plan_scenes
from avssl_pyro.simulation.scenes import SceneSimulator

NUM_SCENES = 10


@pytest.fixture(scope="session")
def scene_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten scenes of the eight-microphone array in shards of four."""
    folder = tmp_path_factory.mktemp("scenes")
    generate(plan_scenes(folder, SceneSimulator(seed=7), NUM_SCENES, scenes_per_shard=4), workers=1, progress=False)
    return folder

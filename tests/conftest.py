"""Fixtures shared by the packages' tests: a handful of real scenes, rendered once per test process."""

import errno
import os
from pathlib import Path

import pytest
import torch
from hypothesis import settings

from avssl_pyro.data.generation import generate
from avssl_pyro.data.scene_plan import plan_scenes
from avssl_pyro.simulation.scenes import SceneSimulator

NUM_SCENES = 10

# A deadline per example would fail on a busy machine.
settings.register_profile("avssl", deadline=None)
settings.load_profile("avssl")

# Tensors as small as the tests' gain nothing from threads, and beside other workers lose much to them.
torch.set_num_threads(1)


@pytest.fixture(scope="session")
def scene_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten scenes of the eight-microphone array in shards of four."""
    folder = tmp_path_factory.mktemp("scenes")
    generate(plan_scenes(folder, SceneSimulator(seed=7), NUM_SCENES, scenes_per_shard=4), workers=1, progress=False)
    return folder


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on, every atomic write finds the disk full after its bytes were written, just before they are safe."""

    def no_space(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("avssl_pyro.atomic_file.os.fsync", no_space)

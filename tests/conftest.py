"""Fixtures shared by the packages' tests: a handful of real scenes, rendered once per test process."""

import errno
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import torch
from hypothesis import settings

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.datasets.generation import generate
from avssl_pyro.datasets.scene_plan import plan_scenes
from avssl_pyro.simulation.scenes import SceneSimulator

# Makes tests/support importable here and, since they inherit sys.path, in worker processes.
sys.path.insert(0, str(Path(__file__).parent / "support"))

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


@pytest.fixture(scope="session")
def write_sofa(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Writes a SOFA file of impulse responses that are pure delays, as the array has them in free field.

    The responses are periodic, so that they are exact at multiples of 31.25 Hz, and 10 ms late. Keywords replace what
    the file says otherwise.
    """

    import sofar

    def write(array: MicrophoneArray, azimuths_deg: npt.ArrayLike, **changes: Any) -> Path:
        azimuths = np.deg2rad(azimuths_deg)
        toward_dx = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros_like(azimuths)], axis=-1)
        delay_dm = 0.01 - toward_dx @ array.positions.T / array.speed_of_sound
        frequencies = np.fft.rfftfreq(1024, 1 / 32_000)
        sofa = sofar.Sofa("GeneralFIR")
        sofa.Data_IR = np.fft.irfft(np.exp(-2j * np.pi * frequencies * delay_dm[..., None]))
        sofa.Data_SamplingRate = 32_000.0
        sofa.Data_Delay = np.zeros((1, array.num_microphones))
        sofa.ReceiverPosition = array.positions
        sofa.SourcePosition = np.stack([np.rad2deg(azimuths), np.zeros_like(azimuths), np.ones_like(azimuths)], axis=-1)
        for name, value in changes.items():
            setattr(sofa, name, value)
        path = tmp_path_factory.mktemp("sofa") / "measured.sofa"
        sofar.write_sofa(str(path), sofa)
        return path

    return write

"""A stand-in for the scene simulator: tells every scene, channel and column apart, and costs next to nothing."""

import errno
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.clip import IMAGE_COLUMNS, IMAGE_ROWS, Clip, SceneLabels
from avssl_pyro.datasets.generation import GenerationPlan


@dataclass(frozen=True)
class FakeScene:
    clip: Clip
    labels: SceneLabels
    metadata: dict[str, Any]


@dataclass(frozen=True)
class FakeSimulator:
    """Audio of channel m is noise around (m + 1) / 50; the image is a smooth gradient, shifted from scene to scene.

    Args:
        disk_full_at: rendering this scene fails as a full disk does.
        log: folder in which every rendered scene leaves a mark.
        pause: seconds per scene.
    """

    array: MicrophoneArray = field(default_factory=lambda: PRESETS["circle246"])
    seed: int = 0
    num_samples: int = 320
    disk_full_at: int | None = None
    log: Path | None = None
    pause: float = 0.0

    def render(self, index: int) -> FakeScene:
        if self.log is not None:
            (self.log / f"{index}-{time.time_ns()}").touch()
        if index == self.disk_full_at:
            raise OSError(errno.ENOSPC, "No space left on device")
        time.sleep(self.pause)
        rng = np.random.default_rng((self.seed, index))
        levels_m1 = (1 + np.arange(self.array.num_microphones)[:, None]) / 50
        audio_mn = levels_m1 + 0.005 * rng.standard_normal((self.array.num_microphones, self.num_samples))
        row_i, column_j = np.arange(IMAGE_ROWS)[:, None], np.arange(IMAGE_COLUMNS)[None]
        red_ij = np.broadcast_to(127 + 100 * np.sin(2 * np.pi * (column_j + 10 * index) / IMAGE_COLUMNS), (88, 288))
        green_ij = np.broadcast_to(2.0 * row_i, (88, 288))
        image_ijc = np.stack([red_ij, green_ij, np.full((88, 288), 40.0)], axis=-1)
        return FakeScene(
            Clip(f"fake-{self.seed}-{index:06d}", audio_mn.astype(np.float32), image_ijc.astype(np.uint8)),
            SceneLabels((np.deg2rad(10.0 * index % 180),), (-np.deg2rad(37.5),)),
            {"index": index, "rt60_s": 0.25},
        )


def fake_plan(folder: Path, num_scenes: int, simulator: FakeSimulator, scenes_per_shard: int = 4) -> GenerationPlan:
    configuration = {"num_samples": simulator.num_samples, "nested": {"levels_db": (-2.5, 2.5)}}
    return GenerationPlan(
        folder, simulator, configuration, simulator.seed, simulator.array, num_scenes, scenes_per_shard
    )

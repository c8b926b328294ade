"""Accuracy of the estimated yaw and mirror of a camera, on simulated recordings with misaligned cameras."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.benchmarks.cache import ResultCache
from avssl_pyro.clip import SAMPLE_RATE, Clip
from avssl_pyro.diagnosis.camera import judge, orientation_search
from avssl_pyro.diagnosis.finding import Severity
from avssl_pyro.evaluation.tables import Column, Table
from avssl_pyro.io.images import fit_image
from avssl_pyro.simulation.recordings import Camera, RecordingSimulator
from avssl_pyro.systems.system import System

WINDOW_S = 1.0
TOLERATED_DEG = 5.0
FORMAT = "avssl-camera/2"


@dataclass(frozen=True)
class CameraTrial:
    """Estimated orientation of the camera of one recording.

    Args:
        index: number of the recording.
        yaw_deg, mirror: true orientation of its camera, degrees.
        found_yaw_deg, found_mirror: orientation of the best fit, degrees.
        confidence: confidence of the yaw by the search.
        decided: whether the examination reports the orientation, or that it is undecided.
    """

    index: int
    yaw_deg: float
    mirror: bool
    found_yaw_deg: float
    found_mirror: bool
    confidence: float
    decided: bool

    @property
    def error_deg(self) -> float:
        """Error of the yaw, degrees from 0 to 180."""
        return float(np.rad2deg(np.abs(wrap_angle(np.deg2rad(self.found_yaw_deg - self.yaw_deg)))))

    @property
    def right(self) -> bool:
        """Whether it is decided, with the right mirror and the yaw within 5 degrees."""
        return self.decided and self.found_mirror == self.mirror and self.error_deg <= TOLERATED_DEG

    @property
    def verdict(self) -> str:
        """Word of the table for it."""
        return "yes" if self.right else "no" if self.decided else "undecided"


@dataclass(frozen=True)
class CameraExperiment:
    """Recordings whose cameras are turned by a random angle, and mirrored with probability one half.

    Sound and images go from the simulation to the search without a video codec in between.

    Args:
        simulator: simulator of the recordings; yaw and mirror of its camera are drawn, its width is kept.
        system: trained system of the search.
    """

    simulator: RecordingSimulator
    system: System

    def camera(self, index: int) -> Camera:
        """Camera of recording ``index``."""
        rng = np.random.default_rng([self.simulator.seed, index])
        return replace(self.simulator.camera, yaw=float(rng.uniform(-np.pi, np.pi)), mirror=bool(rng.uniform() < 0.5))

    def clips(self, index: int) -> list[Clip]:
        """Seconds of recording ``index``, each with the image in its middle."""
        recording = replace(self.simulator, camera=self.camera(index)).draw(index)
        audio_mn, film = recording.render_audio(), recording.render_video()
        length = round(WINDOW_S * SAMPLE_RATE)
        return [
            Clip(
                f"{index}-{number}",
                np.ascontiguousarray(audio_mn[:, number * length : (number + 1) * length]),
                fit_image(film.frame_at((number + 0.5) * WINDOW_S), f"recording {index}"),
            )
            for number in range(audio_mn.shape[1] // length)
        ]

    def run(self, index: int) -> CameraTrial:
        """Simulates recording ``index`` and estimates the orientation of its camera."""
        clips = self.clips(index)
        found = orientation_search(self.system).search([clip for clip in clips if clip.audio_mn.any()])
        camera = self.camera(index)
        (finding,) = judge(found, self.system.config.array)
        return CameraTrial(
            index,
            float(np.rad2deg(camera.yaw)),
            camera.mirror,
            found.yaw_deg,
            found.mirror,
            found.yaw_confidence,
            finding.severity != Severity.NOTE,
        )

    def run_all(self, recordings: int, folder: Path, settings: Mapping[str, Any]) -> list[CameraTrial]:
        """Trials of all recordings; those of the same settings are stored in the folder and found again.

        Raises:
            InputError, OSError: a stored trial is damaged, or a new one cannot be written.
        """
        cache = ResultCache(folder, CameraTrial, FORMAT)
        return [
            cache.get_or_run(f"{index:05d}", settings, partial(self.run, index))
            for index in tqdm(range(recordings), unit="recording", desc="turning cameras")
        ]


def _yes(value: bool) -> str:
    return "yes" if value else "no"


COLUMNS: tuple[Column[CameraTrial], ...] = (
    Column("recording", lambda trial: trial.index),
    Column("yaw", lambda trial: trial.yaw_deg, "{:.1f}°"),
    Column("mirrored", lambda trial: _yes(trial.mirror)),
    Column("found yaw", lambda trial: trial.found_yaw_deg, "{:.1f}°"),
    Column("found mirrored", lambda trial: _yes(trial.found_mirror)),
    Column("error", lambda trial: trial.error_deg, "{:.1f}°"),
    Column("confidence", lambda trial: trial.confidence, "{:.0%}"),
    Column("right", lambda trial: trial.verdict),
)


def camera_table(trials: Sequence[CameraTrial], array: str, seconds: float) -> Table[CameraTrial]:
    """One line for each recording."""
    right = sum(trial.right for trial in trials)
    return Table(trials, COLUMNS, f"{array}: found in {right} of {len(trials)} recordings of {seconds:g} s")

"""How often the camera's yaw and mirror are found: simulated recordings with cameras that stand wrong."""

from dataclasses import asdict, dataclass, replace

import numpy as np

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.clip import SAMPLE_RATE, Clip
from avssl_pyro.diagnosis.camera import judge, orientation_search
from avssl_pyro.diagnosis.finding import Severity
from avssl_pyro.io.clip_files import fit_image
from avssl_pyro.simulation.camera import Camera
from avssl_pyro.simulation.recordings import RecordingSimulator
from avssl_pyro.systems.system import System

WINDOW_S = 1.0
TOLERATED_DEG = 5.0


@dataclass(frozen=True)
class CameraTrial:
    """What was found in a recording.

    Args:
        index: of the recording.
        yaw_deg, mirror: of its camera.
        found_yaw_deg, found_mirror: what fits best.
        confidence: of the yaw, as the search tells it.
        told: whether the doctor tells it, rather than that it cannot tell.
    """

    index: int
    yaw_deg: float
    mirror: bool
    found_yaw_deg: float
    found_mirror: bool
    confidence: float
    told: bool

    @property
    def error_deg(self) -> float:
        """Of the yaw, degrees from 0 to 180."""
        return float(np.rad2deg(np.abs(wrap_angle(np.deg2rad(self.found_yaw_deg - self.yaw_deg)))))

    @property
    def right(self) -> bool:
        """Told, with the right mirror and the yaw within 5 degrees."""
        return self.told and self.found_mirror == self.mirror and self.error_deg <= TOLERATED_DEG

    def to_dict(self) -> dict[str, object]:
        return asdict(self)


@dataclass(frozen=True)
class CameraExperiment:
    """Recordings whose cameras are turned by any angle, and every other one by chance mirrored.

    Sound and pictures go straight from the simulation to the search, second by second as the doctor takes them from
    files, without a video codec between.

    Args:
        simulator: of the recordings; its camera's width is used, its yaw and mirror are drawn.
        system: that looks.
    """

    simulator: RecordingSimulator
    system: System

    def camera(self, index: int) -> Camera:
        """The camera of recording ``index``."""
        rng = np.random.default_rng([self.simulator.seed, index])
        return replace(self.simulator.camera, yaw=float(rng.uniform(-np.pi, np.pi)), mirror=bool(rng.uniform() < 0.5))

    def clips(self, index: int) -> list[Clip]:
        """The seconds of recording ``index``, each with the picture in the middle of it."""
        recording = replace(self.simulator, camera=self.camera(index)).draw(index)
        audio_mn, film = recording.record(), recording.film()
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
        """Simulates recording ``index`` and looks for its camera."""
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

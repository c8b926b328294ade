"""The 360-degree video of a recording's people: what a camera above the array sees at any time."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.simulation.compositing import Layer, Standing, View, blend, project, relight
from avssl_pyro.simulation.moving_people import MovingPeople
from avssl_pyro.simulation.panoramas import PanoramaSource, whole_sphere
from avssl_pyro.simulation.people import PersonSource

# Cut-outs have fewer rows than the bodies of such a picture; finer rendering would not show.
SHARP_COLUMNS = 1152


@dataclass(frozen=True)
class Camera:
    """The camera of a recording, over the array.

    Args:
        columns: width of its pictures, full spheres twice as wide as high.
        yaw: azimuth, seen from the array, of what the centre of the picture shows, radians.
        mirror: whether the picture shows left and right exchanged.
    """

    columns: int = 1920
    yaw: float = 0.0
    mirror: bool = False

    @property
    def view(self) -> View:
        return View(self.columns // 2, self.columns, 1 if self.columns >= SHARP_COLUMNS else 3)


class PanoramaVideo:
    """Frames at any time; those of a standing person are rendered once.

    Args:
        people: who is where.
        camera: what sees them.
        person_source, panorama_source: the material.
        rng: which of it, in which light.
    """

    def __init__(
        self,
        people: MovingPeople,
        camera: Camera,
        person_source: PersonSource,
        panorama_source: PanoramaSource,
        rng: np.random.Generator,
    ) -> None:
        self.people = people
        self.camera = camera
        height_m = people.room.array_height_m
        panorama_ijc = panorama_source.draw(rng, height_m)
        facing = float(rng.uniform(-np.pi, np.pi))
        self._background_ijc = relight(whole_sphere(panorama_ijc, facing - camera.yaw, camera.columns), rng)
        self._cutouts = [relight(person_source.draw(rng), rng) for _ in people.distances_s]
        self._layers: dict[int, tuple[float, Layer]] = {}

    def frame_at(self, time_s: float) -> npt.NDArray[np.uint8]:
        """What the camera sees, uint8 RGB, (columns / 2, columns, 3)."""
        frame_ijc = self._background_ijc.copy()
        azimuth_s = self.people.azimuths_at(np.array([time_s]))[:, 0]
        for s in np.argsort(-self.people.distances_s).tolist():
            layer = self._layer(s, float(azimuth_s[s]))
            frame_ijc[layer.rows, layer.columns_j] = np.rint(np.clip(blend(frame_ijc, layer), 0, 255))
        return np.asarray(cv2.flip(frame_ijc, 1), dtype=np.uint8) if self.camera.mirror else frame_ijc

    def _layer(self, s: int, azimuth: float) -> Layer:
        known = self._layers.get(s)
        if known is None or known[0] != azimuth:
            place = Standing(
                azimuth - self.camera.yaw, float(self.people.distances_s[s]), float(self.people.heights_s[s])
            )
            layer = project(self._cutouts[s], place, self.people.room.array_height_m, self.camera.view)
            known = self._layers[s] = (azimuth, layer)
        return known[1]

"""Simulation of whole recordings: an array in a room with people, a camera above it, and the true labels."""

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.io.dcase import DcaseRow
from avssl_pyro.simulation.compositing import (
    PanoramaView,
    PersonLayer,
    PersonPosition,
    blend_layer,
    project,
    relight,
)
from avssl_pyro.simulation.dialogue import DrySpeech, dialogue_labels, draw_dialogue, render_dialogue
from avssl_pyro.simulation.motion import MovingPeople, MovingPeopleConfig, draw_moving_people
from avssl_pyro.simulation.moving_source import MotionResolution, add_noise
from avssl_pyro.simulation.panoramas import PanoramaSource, to_full_sphere
from avssl_pyro.simulation.people import PersonSource
from avssl_pyro.simulation.scenes import check_room_simulation
from avssl_pyro.simulation.speech import SpeechSource
from avssl_pyro.simulation.synthetic.people import ProceduralPerson
from avssl_pyro.simulation.synthetic.rooms import ProceduralRoom
from avssl_pyro.simulation.synthetic.speech import ProceduralSpeech
from avssl_pyro.validators import at_least

# Cut-outs have fewer rows than bodies in pictures of this width; finer rendering would not show.
SHARP_COLUMNS = 1152


@dataclass(frozen=True)
class Camera:
    """The 360-degree camera of a recording, at the array's position.

    Args:
        columns: width of the pictures, pixels; full spheres, twice as wide as high.
        yaw: azimuth of the picture's centre in the array's coordinates, radians.
        mirror: exchange of left and right in the picture.
    """

    columns: int = 1920
    yaw: float = 0.0
    mirror: bool = False

    @property
    def view(self) -> PanoramaView:
        return PanoramaView(self.columns // 2, self.columns, 1 if self.columns >= SHARP_COLUMNS else 3)


class PanoramaVideo:
    """Frames of a recording at any time; the layer of a standing person is rendered once.

    Args:
        people: positions of the people.
        camera: camera that takes the frames.
        person_source, panorama_source: cut-outs and background.
        rng: random choice of cut-outs, background and lighting.
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
        panorama_ijc = panorama_source.draw(rng, people.room.array_height_m)
        facing = float(rng.uniform(-np.pi, np.pi))
        self._background_ijc = relight(to_full_sphere(panorama_ijc, facing - camera.yaw, camera.columns), rng)
        self._cutouts = [relight(person_source.draw(rng), rng) for _ in people.distances_s]
        self._layers: dict[int, tuple[float, PersonLayer]] = {}

    def frame_at(self, time_s: float) -> npt.NDArray[np.uint8]:
        """Frame at a time in seconds, uint8 RGB, (columns / 2, columns, 3)."""
        frame_ijc = self._background_ijc.copy()
        azimuth_s = self.people.azimuths_at(np.array([time_s]))[:, 0]
        for s in np.argsort(-self.people.distances_s).tolist():
            layer = self._layer(s, float(azimuth_s[s]))
            frame_ijc[layer.rows, layer.columns_j] = np.rint(np.clip(blend_layer(frame_ijc, layer), 0, 255))
        return np.asarray(cv2.flip(frame_ijc, 1), dtype=np.uint8) if self.camera.mirror else frame_ijc

    def _layer(self, s: int, azimuth: float) -> PersonLayer:
        known = self._layers.get(s)
        if known is None or known[0] != azimuth:
            position = PersonPosition(
                azimuth - self.camera.yaw, float(self.people.distances_s[s]), float(self.people.heights_s[s])
            )
            layer = project(self._cutouts[s], position, self.people.room.array_height_m, self.camera.view)
            known = self._layers[s] = (azimuth, layer)
        return known[1]


@dataclass(frozen=True)
class RecordingSimulator:
    """Simulates recording number ``index``, independently of all others.

    All randomness derives from (seed, index), in separate streams for people, voices, noise and picture. Recordings
    that differ in array or camera alone thus have the same people, who say the same.

    Args:
        config: distribution of rooms and people.
        seed: seed of all recordings.
        array: microphones, of any kind but measured responses.
        camera: camera at the array's position.
        resolution: resolution at which the sound of trajectories is rendered.
        speech, people, panoramas: sources of voices, cut-outs and backgrounds; made in code by default.

    Raises:
        InputError: the seed is negative, or rooms cannot be simulated for this kind of array.
    """

    config: MovingPeopleConfig = field(default_factory=MovingPeopleConfig)
    seed: int = 0
    array: MicrophoneArray = PRESETS["starss23-mic"]
    camera: Camera = field(default_factory=Camera)
    resolution: MotionResolution = field(default_factory=lambda: MotionResolution(cell_deg=1.0))
    speech: SpeechSource = field(default_factory=ProceduralSpeech)
    people: PersonSource = field(default_factory=ProceduralPerson)
    panoramas: PanoramaSource = field(default_factory=ProceduralRoom)

    def __post_init__(self) -> None:
        at_least(0).check(self, "seed")
        check_room_simulation(self.array)

    def draw(self, index: int) -> "SimulatedRecording":
        """Draws people and voices of recording ``index``; sound and picture are rendered later, on demand."""
        streams = [
            np.random.default_rng(child) for child in np.random.SeedSequence(self.seed, spawn_key=(index,)).spawn(4)
        ]
        people = draw_moving_people(self.config, streams[0])
        return SimulatedRecording(self, people, draw_dialogue(people, self.speech, streams[1]), streams[2], streams[3])


@dataclass(frozen=True)
class SimulatedRecording:
    """People and voices of one recording; its sound and its picture can be rendered once each.

    Args:
        simulator: simulator that drew the recording.
        people, voices: true positions and dry voices.
        noise_rng, image_rng: random streams of the sensor noise and of the picture.
    """

    simulator: RecordingSimulator
    people: MovingPeople
    voices: DrySpeech
    noise_rng: np.random.Generator
    image_rng: np.random.Generator

    def render_audio(self) -> npt.NDArray[np.float32]:
        """Recorded sound, (M, N), float32, 16 kHz, with sensor noise and a peak of 0.5."""
        mixture_mn = render_dialogue(self.people, self.voices, self.simulator.array, self.simulator.resolution)
        return add_noise(mixture_mn, self.simulator.config.scenes.snr_db, self.noise_rng)

    def render_video(self) -> PanoramaVideo:
        """Video of the camera, rendered frame by frame on demand."""
        simulator = self.simulator
        return PanoramaVideo(self.people, simulator.camera, simulator.people, simulator.panoramas, self.image_rng)

    @property
    def seconds(self) -> float:
        """Length of the recording in seconds."""
        return self.voices.sounding_st.shape[1] / 10

    @property
    def num_people(self) -> int:
        return len(self.people.distances_s)

    @property
    def num_talkers(self) -> int:
        """Number of people who talk at any time."""
        return int(self.voices.sounding_st.any(axis=1).sum())

    @property
    def labels(self) -> tuple[DcaseRow, ...]:
        """Active talkers in every frame of 100 ms, in the array's coordinates."""
        return dialogue_labels(self.people, self.voices)

"""Simulates whole recordings: an array in a room with people, the camera above it, and the truth."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.errors import InputError
from avssl_pyro.io.dcase import DcaseRow
from avssl_pyro.simulation.camera import Camera, PanoramaVideo
from avssl_pyro.simulation.dialogue import DryVoices, hear, labels, speak
from avssl_pyro.simulation.moving_people import MovingPeople, MovingPeopleConfig, draw_moving_people
from avssl_pyro.simulation.moving_source import Steps, with_noise
from avssl_pyro.simulation.panoramas import PanoramaSource
from avssl_pyro.simulation.people import PersonSource
from avssl_pyro.simulation.scenes import check_known_all_around
from avssl_pyro.simulation.speech import SpeechSource
from avssl_pyro.simulation.synthetic_people import ProceduralPerson
from avssl_pyro.simulation.synthetic_rooms import ProceduralRoom
from avssl_pyro.simulation.synthetic_speech import ProceduralSpeech

PEAK = 0.5


@dataclass(frozen=True)
class RecordingSimulator:
    """Recording number ``index``, whatever was simulated before.

    All randomness comes from (seed, index), in streams of its own for people, voices, noise and picture; so the same
    people say the same to another array, and look the same to a camera that is turned or mirrored.

    Args:
        config: what is drawn.
        seed: of all recordings.
        array: what hears; of any kind but measured responses.
        camera: what sees, in the array's place.
        steps: how finely walks are heard.
        speech, people, panoramas: the material; made in code by default.

    Raises:
        InputError: the seed is negative, or the array is of a kind that rooms are not simulated for.
    """

    config: MovingPeopleConfig = field(default_factory=MovingPeopleConfig)
    seed: int = 0
    array: MicrophoneArray = PRESETS["starss23-mic"]
    camera: Camera = field(default_factory=Camera)
    steps: Steps = field(default_factory=lambda: Steps(cell_deg=1.0))
    speech: SpeechSource = field(default_factory=ProceduralSpeech)
    people: PersonSource = field(default_factory=ProceduralPerson)
    panoramas: PanoramaSource = field(default_factory=ProceduralRoom)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InputError(f"the seed is {self.seed}; it must be 0 or more.")
        check_known_all_around(self.array)

    def draw(self, index: int) -> "SimulatedRecording":
        """Draws recording ``index``; nothing is rendered yet."""
        streams = [
            np.random.default_rng(child) for child in np.random.SeedSequence(self.seed, spawn_key=(index,)).spawn(4)
        ]
        people = draw_moving_people(self.config, streams[0])
        return SimulatedRecording(self, people, speak(people, self.speech, streams[1]), streams[2], streams[3])


@dataclass(frozen=True)
class SimulatedRecording:
    """A recording's people and voices; sound and picture are rendered on demand, each of them once.

    Args:
        simulator: that drew it.
        people, voices: the truth.
        noise, light: the streams of its noise and of its picture.
    """

    simulator: RecordingSimulator
    people: MovingPeople
    voices: DryVoices
    noise: np.random.Generator
    light: np.random.Generator

    def record(self) -> npt.NDArray[np.float32]:
        """What the array hears, (M, N), float32, 16 kHz, with sensor noise and a peak of 0.5."""
        mixture_mn = hear(self.people, self.voices, self.simulator.array, self.simulator.steps)
        return with_noise(mixture_mn, self.simulator.config.scenes.snr_db, PEAK, self.noise)

    def film(self) -> PanoramaVideo:
        """What the camera sees."""
        one = self.simulator
        return PanoramaVideo(self.people, one.camera, one.people, one.panoramas, self.light)

    @property
    def labels(self) -> tuple[DcaseRow, ...]:
        """Who sounds, by 100 ms, as the array hears it."""
        return labels(self.people, self.voices)

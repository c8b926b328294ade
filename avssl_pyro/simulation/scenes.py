"""Renders scenes: one second of a microphone array and the 360-degree image that goes with it."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering_kinds import MeasuredKind
from avssl_pyro.clip import SAMPLE_RATE, Clip, SceneLabels
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.compositing import Composite, composite, relight
from avssl_pyro.simulation.layout import Layout, PersonFacts, SceneConfig, draw_layout
from avssl_pyro.simulation.panoramas import PanoramaSource, face
from avssl_pyro.simulation.people import PersonSource
from avssl_pyro.simulation.reverberation import reverberate, room_responses
from avssl_pyro.simulation.speech import SpeechSource
from avssl_pyro.simulation.synthetic_people import ProceduralPerson
from avssl_pyro.simulation.synthetic_rooms import ProceduralRoom
from avssl_pyro.simulation.synthetic_speech import ProceduralSpeech

# Speech begins this long before the clip, so that the room is already sounding when the clip starts.
LEAD_SAMPLES = SAMPLE_RATE // 5
# Silence (relative to speech of unit power) is left silent instead of being divided by.
MIN_POWER = 1e-10


@dataclass(frozen=True)
class Scene:
    """A finished scene.

    Args:
        clip: what training sees.
        labels: azimuths, for evaluation only.
        people: everyone in the scene, talkers and silent.
        rt60_s: reverberation time.
        camera_height_m: height of camera and array above the floor.
        room_yaw: azimuth of the room's own x axis, radians.
    """

    clip: Clip
    labels: SceneLabels
    people: tuple[PersonFacts, ...]
    rt60_s: float
    camera_height_m: float
    room_yaw: float

    @property
    def facts(self) -> dict[str, Any]:
        """The truth, JSON-able, in degrees, metres and seconds."""
        return {
            "people": [person.to_dict() for person in self.people],
            "rt60_s": round(self.rt60_s, 4),
            "camera_height_m": round(self.camera_height_m, 4),
            "room_yaw_deg": round(float(np.rad2deg(self.room_yaw)), 4),
        }


@dataclass(frozen=True)
class SceneSimulator:
    """Scene number ``index`` of a data set, whatever was rendered before, wherever it is rendered.

    All randomness comes from (seed, index), split into independent streams for layout, image, voices and noise; so two
    simulators with different sources or arrays still agree on who stands where. Data sets that must not overlap take
    different seeds (and different folders). Every scene has a room response of its own; none is reused.

    Args:
        config: what to draw.
        seed: of the data set.
        speech, people, panoramas: the material; made in code by default.
        array: the microphones, around the camera; the union of the paper's circles by default.

    Raises:
        InputError: the seed is negative, or the array is of a kind that rooms are not rendered for.
    """

    config: SceneConfig = field(default_factory=SceneConfig)
    seed: int = 0
    speech: SpeechSource = field(default_factory=ProceduralSpeech)
    people: PersonSource = field(default_factory=ProceduralPerson)
    panoramas: PanoramaSource = field(default_factory=ProceduralRoom)
    array: MicrophoneArray = PRESETS["circle246"]

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InputError(f"the seed is {self.seed}; it must be 0 or more.")
        check_known_all_around(self.array)

    def render(self, index: int) -> Scene:
        """Renders scene ``index``.

        Raises:
            InputError: a negative index, or material that cannot be used; the message names the file.
        """
        layout = self.layout(index)
        audio_mn = self._record(index, layout)
        clip = Clip(f"{index:06d}", audio_mn, self.render_image(index).image_ijc)
        labels = SceneLabels(
            talker_azimuths=tuple(person.azimuth for person in layout.people if person.speaks),
            silent_azimuths=tuple(person.azimuth for person in layout.people if not person.speaks),
        )
        return Scene(clip, labels, layout.people, layout.rt60_s, layout.camera_height_m, layout.room_yaw)

    def layout(self, index: int) -> Layout:
        """Who stands where in scene ``index``."""
        return draw_layout(self.config, self._streams(index)[0])

    def render_image(self, index: int, *, with_people: bool = True) -> Composite:
        """The image of scene ``index`` and where each person shows; without people, the same room in the same light."""
        layout, rng = self.layout(index), self._streams(index)[1]
        panorama_ijc = self.panoramas.draw(rng, layout.camera_height_m)
        background_ijc = relight(face(panorama_ijc, layout.room_yaw), rng)
        if not with_people:
            layout = layout.alone()
        cutouts = [self._draw_cutout(rng) for _ in layout.people]
        return composite(background_ijc, cutouts, [person.standing for person in layout.people], layout.camera_height_m)

    def render_talkers(self, index: int) -> npt.NDArray[np.float32]:
        """Each talker alone in the room, (S, M, N), ordered as ``labels.talker_azimuths``, before noise and gain."""
        layout = self.layout(index)
        return self._talkers(index, layout, max_order=None)

    def render_direct(self, index: int) -> npt.NDArray[np.float32]:
        """As :meth:`render_talkers`, without any reflection."""
        return self._talkers(index, self.layout(index), max_order=0)

    def _streams(self, index: int) -> list[np.random.Generator]:
        if index < 0:
            raise InputError(f"scene index {index} is negative; scenes count from 0.")
        sequence = np.random.SeedSequence(self.seed, spawn_key=(index,))
        return [np.random.default_rng(child) for child in sequence.spawn(4)]

    def _draw_cutout(self, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
        cutout_ijc = relight(self.people.draw(rng), rng)
        return np.ascontiguousarray(cutout_ijc[:, ::-1]) if rng.uniform() < 0.5 else cutout_ijc

    def _talkers(self, index: int, layout: Layout, max_order: int | None) -> npt.NDArray[np.float32]:
        rng = self._streams(index)[2]
        positions_sx = np.array(
            [
                [
                    person.distance_m * np.cos(person.azimuth),
                    person.distance_m * np.sin(person.azimuth),
                    person.mouth_height_m - layout.camera_height_m,
                ]
                for person in layout.talkers
            ]
        )
        responses_sml = room_responses(
            self.array,
            positions_sx,
            room_dims_m=self.config.room_dims_m,
            height_m=layout.camera_height_m,
            room_yaw=layout.room_yaw,
            rt60_s=layout.rt60_s,
            max_order=max_order,
        )
        num_samples = self.config.num_samples
        wet_smn = np.empty((len(positions_sx), self.array.num_microphones, num_samples), dtype=np.float32)
        for s, (person, responses_ml) in enumerate(zip(layout.talkers, responses_sml, strict=True)):
            dry_n = self.speech.draw(rng, num_samples + LEAD_SAMPLES)
            wet_mn = reverberate(dry_n, responses_ml, num_samples)
            power = max(_power(wet_mn), MIN_POWER)
            wet_smn[s] = wet_mn * np.float32(10 ** ((person.level_db or 0.0) / 20) / np.sqrt(power))
        return wet_smn

    def _record(self, index: int, layout: Layout) -> npt.NDArray[np.float32]:
        rng = self._streams(index)[3]
        mixture_mn: npt.NDArray[np.float32] = self._talkers(index, layout, max_order=None).sum(axis=0)
        noise_rms = np.sqrt(_power(mixture_mn) / 10 ** (self.config.snr_db / 10))
        mixture_mn += np.float32(noise_rms) * rng.standard_normal(mixture_mn.shape, dtype=np.float32)
        peak = 10 ** (rng.uniform(*self.config.peak_range_db) / 20)
        mixture_mn *= np.float32(peak / max(float(np.abs(mixture_mn).max()), MIN_POWER))
        return mixture_mn


def check_known_all_around(array: MicrophoneArray) -> None:
    """Refuses an array for which rooms cannot be simulated.

    Raises:
        InputError: its responses were measured, in horizontal directions only.
    """
    if isinstance(array.steering, MeasuredKind):
        raise InputError(
            f"array '{array.name}' hears {array.steering.phrase}, in horizontal directions alone, but a room reflects "
            "sound from above and below; give recordings of this array instead."
        )


def _power(audio_mn: npt.NDArray[np.float32]) -> float:
    return float(np.mean(np.square(audio_mn, dtype=np.float64)))

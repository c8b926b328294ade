"""Simulation of scenes: one second of multichannel audio, a 360-degree image, and the true labels."""

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
from avssl_pyro.simulation.layout import Layout, PersonMetadata, SceneConfig, draw_layout
from avssl_pyro.simulation.panoramas import PanoramaSource, to_clip_image
from avssl_pyro.simulation.people import PersonSource
from avssl_pyro.simulation.reverberation import reverberate, room_responses
from avssl_pyro.simulation.speech import SpeechSource
from avssl_pyro.simulation.synthetic.people import ProceduralPerson
from avssl_pyro.simulation.synthetic.rooms import ProceduralRoom
from avssl_pyro.simulation.synthetic.speech import ProceduralSpeech
from avssl_pyro.validators import at_least

# Speech begins this long before the clip, so that the clip starts with reverberation.
LEAD_SAMPLES = SAMPLE_RATE // 5
# Least power by which a signal is normalized (speech has unit power), so that silence stays silent.
MIN_POWER = 1e-10


@dataclass(frozen=True)
class SimulatedScene:
    """A rendered scene.

    Args:
        clip: audio and image.
        labels: true azimuths, for evaluation only.
        people: all people of the scene, talkers and silent people.
        rt60_s: reverberation time, seconds.
        camera_height_m: height of camera and array above the floor, metres.
        room_yaw: azimuth of the room's x axis, radians.
    """

    clip: Clip
    labels: SceneLabels
    people: tuple[PersonMetadata, ...]
    rt60_s: float
    camera_height_m: float
    room_yaw: float

    @property
    def metadata(self) -> dict[str, Any]:
        """Plain JSON values that describe the scene, in degrees, metres and seconds."""
        return {
            "people": [person.to_dict() for person in self.people],
            "rt60_s": round(self.rt60_s, 4),
            "camera_height_m": round(self.camera_height_m, 4),
            "room_yaw_deg": round(float(np.rad2deg(self.room_yaw)), 4),
        }


@dataclass(frozen=True)
class SceneSimulator:
    """Simulates scene number ``index`` of a data set, independently of all others and of the machine.

    All randomness derives from (seed, index), in independent streams for layout, image, voices and noise. Simulators
    with other sources or arrays thus draw the same layouts. Data sets that must not overlap need different seeds. Room
    responses are computed for every scene; none is reused.

    Args:
        config: distribution of the scenes.
        seed: seed of the data set.
        speech, people, panoramas: sources of voices, cut-outs and backgrounds; made in code by default.
        array: microphones around the camera; the union of the paper's circles by default.

    Raises:
        InputError: the seed is negative, or rooms cannot be simulated for this kind of array.
    """

    config: SceneConfig = field(default_factory=SceneConfig)
    seed: int = 0
    speech: SpeechSource = field(default_factory=ProceduralSpeech)
    people: PersonSource = field(default_factory=ProceduralPerson)
    panoramas: PanoramaSource = field(default_factory=ProceduralRoom)
    array: MicrophoneArray = PRESETS["circle246"]

    def __post_init__(self) -> None:
        at_least(0).check(self, "seed")
        check_room_simulation(self.array)

    def render(self, index: int) -> SimulatedScene:
        """Renders scene ``index``.

        Raises:
            InputError: the index is negative, or an asset cannot be used; the message names the file.
        """
        layout = self.layout(index)
        audio_mn = self._record(index, layout)
        clip = Clip(f"{index:06d}", audio_mn, self.render_image(index).image_ijc)
        labels = SceneLabels(
            talker_azimuths=tuple(person.azimuth for person in layout.people if person.speaks),
            silent_azimuths=tuple(person.azimuth for person in layout.people if not person.speaks),
        )
        return SimulatedScene(clip, labels, layout.people, layout.rt60_s, layout.camera_height_m, layout.room_yaw)

    def layout(self, index: int) -> Layout:
        """Draws the room and the people of scene ``index``."""
        return draw_layout(self.config, self._streams(index)[0])

    def render_image(self, index: int, *, with_people: bool = True) -> Composite:
        """Renders the image of scene ``index`` and the visible pixels of each person.

        Args:
            index: number of the scene.
            with_people: False gives the same room in the same lighting without people.
        """
        layout, rng = self.layout(index), self._streams(index)[1]
        panorama_ijc = self.panoramas.draw(rng, layout.camera_height_m)
        background_ijc = relight(to_clip_image(panorama_ijc, layout.room_yaw), rng)
        if not with_people:
            layout = layout.without_people()
        cutouts = [self._draw_cutout(rng) for _ in layout.people]
        return composite(background_ijc, cutouts, [person.position for person in layout.people], layout.camera_height_m)

    def render_talkers(self, index: int) -> npt.NDArray[np.float32]:
        """Renders each talker separately, (S, M, N), in the order of the labels, without noise and gain."""
        layout = self.layout(index)
        return self._talkers(index, layout, max_order=None)

    def render_direct(self, index: int) -> npt.NDArray[np.float32]:
        """Renders each talker as :meth:`render_talkers` does, without reflections."""
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


def check_room_simulation(array: MicrophoneArray) -> None:
    """Checks that rooms can be simulated for an array.

    Raises:
        InputError: the array has responses measured in horizontal directions only.
    """
    if isinstance(array.steering, MeasuredKind):
        raise InputError(
            f"array '{array.name}' is {array.steering.description}, of horizontal directions only, but a "
            "room reflects sound from above and below; give recordings of this array instead."
        )


def _power(audio_mn: npt.NDArray[np.float32]) -> float:
    return float(np.mean(np.square(audio_mn, dtype=np.float64)))

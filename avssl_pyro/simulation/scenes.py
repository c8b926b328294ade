"""Simulation of scenes: one second of multichannel audio, a 360-degree image, and the true labels."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering_kinds import FreeFieldKind, MeasuredKind
from avssl_pyro.clip import Clip, SceneLabels
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.acoustics.reverberation import RoomAcoustics, reverberate
from avssl_pyro.simulation.compositing import Composite, composite, relight
from avssl_pyro.simulation.layout import Layout, PersonMetadata, draw_layout
from avssl_pyro.simulation.noise import MIN_POWER, PINK_DB_PER_OCTAVE, Noise, colored_noise, mean_power, scaled
from avssl_pyro.simulation.panoramas import PanoramaSource, RoomShapedPanoramas, to_clip_image
from avssl_pyro.simulation.people import PersonSource
from avssl_pyro.simulation.scene_config import SceneConfig
from avssl_pyro.simulation.speech import SpeechSource
from avssl_pyro.simulation.synthetic.people import ProceduralPerson
from avssl_pyro.simulation.synthetic.rooms import ProceduralRoom
from avssl_pyro.simulation.synthetic.speech import ProceduralSpeech
from avssl_pyro.validators import at_least

# Unseen point sources are this far from the array at least, and from the walls.
POINT_DISTANCE_M, POINT_MARGIN_M = 0.7, 0.1


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
        variations: JSON values of what else varies between scenes of this configuration: room, noise and gains.
    """

    clip: Clip
    labels: SceneLabels
    people: tuple[PersonMetadata, ...]
    rt60_s: float
    camera_height_m: float
    room_yaw: float
    variations: dict[str, Any] = field(default_factory=dict)

    @property
    def metadata(self) -> dict[str, Any]:
        """Plain JSON values that describe the scene, in degrees, metres and seconds."""
        return {
            "people": [person.to_dict() for person in self.people],
            "rt60_s": round(self.rt60_s, 4),
            "camera_height_m": round(self.camera_height_m, 4),
            "room_yaw_deg": round(float(np.rad2deg(self.room_yaw)), 4),
            **self.variations,
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
        return SimulatedScene(
            clip,
            labels,
            layout.people,
            layout.rt60_s,
            layout.camera_height_m,
            layout.room_yaw,
            self._variations(index, layout),
        )

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
        panoramas = self.panoramas
        if layout.camera_floor_m is not None and isinstance(panoramas, RoomShapedPanoramas):
            panoramas = panoramas.in_room(layout.room_dims_m, layout.camera_floor_m)
        panorama_ijc = panoramas.draw(rng, layout.camera_height_m)
        background_ijc = relight(to_clip_image(panorama_ijc, layout.room_yaw), rng, self.config.relight_strength)
        if not with_people:
            layout = layout.without_people()
        cutouts = [self._draw_cutout(rng) for _ in layout.people]
        return composite(background_ijc, cutouts, [person.position for person in layout.people], layout.camera_height_m)

    def render_talkers(self, index: int) -> npt.NDArray[np.float32]:
        """Renders each talker separately, (S, M, N), in the order of the labels, without noise and gains."""
        return self._talkers(index, self.layout(index), direct_only=False)

    def render_direct(self, index: int) -> npt.NDArray[np.float32]:
        """Renders each talker as :meth:`render_talkers` does, without reflections."""
        return self._talkers(index, self.layout(index), direct_only=True)

    def _streams(self, index: int) -> list[np.random.Generator]:
        if index < 0:
            raise InputError(f"scene index {index} is negative; scenes count from 0.")
        sequence = np.random.SeedSequence(self.seed, spawn_key=(index,))
        # Layout, image, voices, samples of the noise; kind of noise, gains, positions of microphones, reverberation.
        return [np.random.default_rng(child) for child in sequence.spawn(8)]

    def _draw_cutout(self, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
        cutout_ijc = relight(self.people.draw(rng), rng, self.config.relight_strength)
        return np.ascontiguousarray(cutout_ijc[:, ::-1]) if rng.uniform() < 0.5 else cutout_ijc

    def _noise(self, index: int, layout: Layout) -> Noise | None:
        if self.config.noise is None:
            return None
        return self.config.noise.draw(self._streams(index)[4], with_talkers=bool(layout.talkers))

    def _gains_db(self, index: int) -> npt.NDArray[np.float64]:
        return self._streams(index)[5].uniform(*self.config.gain_range_db, self.array.num_microphones)

    def _rendered_array(self, index: int) -> MicrophoneArray:
        """Returns the array with microphones off their places; other arrays than those in free field are exact."""
        error_m = self.config.position_error_m
        if error_m == 0.0 or self.array.steering != FreeFieldKind():
            return self.array
        moved_mx = self.array.positions + self._streams(index)[6].uniform(-error_m, error_m, self.array.positions.shape)
        return replace(self.array, positions_m=tuple((x, y, z) for x, y, z in moved_mx.tolist()))

    def _variations(self, index: int, layout: Layout) -> dict[str, Any]:
        variations: dict[str, Any] = {}
        if layout.camera_floor_m is not None:
            variations["room_dims_m"] = [round(side, 4) for side in layout.room_dims_m]
            variations["camera_floor_m"] = [round(place, 4) for place in layout.camera_floor_m]
        noise = self._noise(index, layout)
        if noise is not None:
            variations["noise"] = noise.to_dict()
        if self.config.gain_range_db != (0.0, 0.0):
            variations["gains_db"] = self._gains_db(index).round(4).tolist()
        return variations

    def _talkers(self, index: int, layout: Layout, *, direct_only: bool) -> npt.NDArray[np.float32]:
        streams = self._streams(index)
        responses_sml = self.config.acoustics.responses(
            self._rendered_array(index), layout.talker_positions_sx, layout.room, streams[7], direct_only=direct_only
        )
        num_samples = self.config.num_samples
        num_dry = num_samples + self.config.acoustics.lead_samples(layout.rt60_s)
        wet_smn = np.empty((len(responses_sml), self.array.num_microphones, num_samples), dtype=np.float32)
        for s, (person, responses_ml) in enumerate(zip(layout.talkers, responses_sml, strict=True)):
            wet_mn = reverberate(self.speech.draw(streams[2], num_dry), responses_ml, num_samples)
            power = max(mean_power(wet_mn), MIN_POWER)
            wet_smn[s] = wet_mn * np.float32(10 ** ((person.level_db or 0.0) / 20) / np.sqrt(power))
        return wet_smn

    def _record(self, index: int, layout: Layout) -> npt.NDArray[np.float32]:
        rng = self._streams(index)[3]
        mixture_mn: npt.NDArray[np.float32] = self._talkers(index, layout, direct_only=False).sum(axis=0)
        noise = self._noise(index, layout)
        if noise is None:
            noise_rms = np.sqrt(mean_power(mixture_mn) / 10 ** (self.config.snr_db / 10))
            mixture_mn += np.float32(noise_rms) * rng.standard_normal(mixture_mn.shape, dtype=np.float32)
        else:
            power = mean_power(mixture_mn) if layout.talkers else 1.0
            mixture_mn += noise.render(self._rendered_array(index), mixture_mn.shape[1], power, rng)
            mixture_mn += self._point_noise(index, layout, noise, rng)
        if self.config.gain_range_db != (0.0, 0.0):
            mixture_mn *= (10 ** (self._gains_db(index) / 20)).astype(np.float32)[:, None]
        peak = 10 ** (rng.uniform(*self.config.peak_range_db) / 20)
        mixture_mn *= np.float32(peak / max(float(np.abs(mixture_mn).max()), MIN_POWER))
        return mixture_mn

    def _point_noise(
        self, index: int, layout: Layout, noise: Noise, rng: np.random.Generator
    ) -> npt.NDArray[np.float32]:
        """Renders the unseen point sources, (M, N), anywhere in the room."""
        room, num_samples = layout.room, self.config.num_samples
        positions_sx = _draw_positions(room, len(noise.point_levels_db), rng)
        array = self._rendered_array(index)
        sum_mn = np.zeros((array.num_microphones, num_samples), dtype=np.float32)
        if not noise.point_levels_db:
            return sum_mn
        quietest_db = min(person.level_db or 0.0 for person in layout.talkers)
        num_dry = num_samples + self.config.acoustics.lead_samples(room.rt60_s)
        responses_sml = self.config.acoustics.responses(array, positions_sx, room, rng)
        for level_db, responses_ml in zip(noise.point_levels_db, responses_sml, strict=True):
            dry_n = colored_noise(1, num_dry, PINK_DB_PER_OCTAVE, rng)[0]
            wet_mn = reverberate(dry_n, responses_ml, num_samples)
            sum_mn += scaled(wet_mn, 10 ** ((quietest_db + level_db) / 10))
        return sum_mn


def _draw_positions(room: RoomAcoustics, num_sources: int, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Draws positions inside a room in the array's coordinates, uniform outside a ball around the array, (S, 3)."""
    positions: list[npt.NDArray[np.float64]] = []
    while len(positions) < num_sources:
        inside_x = rng.uniform(POINT_MARGIN_M, np.array(room.dims_m) - POINT_MARGIN_M)
        offset_x = (inside_x - room.array_position) @ room.to_room
        if np.linalg.norm(offset_x) >= POINT_DISTANCE_M:
            positions.append(offset_x)
    return np.array(positions).reshape(-1, 3)


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

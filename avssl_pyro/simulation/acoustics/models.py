"""Models of a room's acoustics: from sources and an array to impulse responses."""

from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.acoustics.arrivals import sum_of_arrivals
from avssl_pyro.simulation.acoustics.diffuse_field import diffuse_field
from avssl_pyro.simulation.acoustics.ray_tracing import RayTracing
from avssl_pyro.simulation.acoustics.reverberation import (
    LEAD_SAMPLES,
    RoomAcoustics,
    eyring_absorption,
    padded_responses,
    reverberant_lead,
    room_responses,
    sum_of_responses,
)
from avssl_pyro.validators import within

# The tail ends after this share of RT60, 45 dB below its start.
TAIL_SHARE = 0.75
# Energy decays by 60 dB within RT60: the exponent 6 ln 10.
DECAY_60_DB = 6 * np.log(10.0)
# The tail replaces reflections over the last part of their range, from this share of the distance on.
FADE_FROM = 0.75
# Reflections beyond this share of the distance determine the level of the tail.
LEVEL_FROM = 0.5


class RoomModel(Protocol):
    """A model of room acoustics; a frozen dataclass whose fields enter manifests."""

    @property
    def kind(self) -> str:
        """Name of the model in manifests."""
        ...

    def lead_samples(self, rt60_s: float) -> int:
        """Returns the duration of speech before the clip, samples."""
        ...

    def responses(
        self,
        array: MicrophoneArray,
        sources_sx: npt.NDArray[np.float64],
        room: RoomAcoustics,
        rng: np.random.Generator,
        *,
        direct_only: bool = False,
    ) -> npt.NDArray[np.float32]:
        """Computes the responses (S, M, L), float32, 16 kHz, as :func:`.room_responses` returns them.

        Args:
            array: M microphones, or channels.
            sources_sx: positions of the sources, (S, 3), metres, in the array's coordinates.
            room: room and place of the array.
            rng: random part of the reverberation, if the model has one.
            direct_only: True leaves out all reflections.
        """
        ...


@dataclass(frozen=True)
class ImageMethod:
    """Reflections of all orders that matter by the image method, see :func:`.room_responses`."""

    kind: str = field(default="image-method", init=False)

    def lead_samples(self, rt60_s: float) -> int:  # noqa: ARG002
        return LEAD_SAMPLES

    def responses(
        self,
        array: MicrophoneArray,
        sources_sx: npt.NDArray[np.float64],
        room: RoomAcoustics,
        rng: np.random.Generator,  # noqa: ARG002
        *,
        direct_only: bool = False,
    ) -> npt.NDArray[np.float32]:
        return room_responses(
            array,
            sources_sx,
            room_dims_m=room.dims_m,
            height_m=room.array_height_m,
            room_yaw=room.room_yaw,
            rt60_s=room.rt60_s,
            array_floor_m=room.array_floor_m,
            max_order=0 if direct_only else None,
        )


IMAGE_METHOD = ImageMethod()


@dataclass(frozen=True)
class ImageMethodWithTail:
    """Early reflections by the image method, followed by a diffuse tail with an exponential decay.

    The tail is isotropic Gaussian noise. Its level continues that of the latest reflections. The cost does not depend
    on the reverberation time. Eyring's formula gives one absorption for all walls and frequencies, which exists for any
    room and reverberation time.

    Args:
        num_reflections: number of reflections before the tail, over all orders.

    Raises:
        InputError: ``num_reflections`` is below 20 or above 100 000.
    """

    num_reflections: int = 300
    kind: str = field(default="image-method-with-tail", init=False)

    def __post_init__(self) -> None:
        within(20, 100_000).check(self, "num_reflections")

    def lead_samples(self, rt60_s: float) -> int:
        return reverberant_lead(rt60_s)

    def responses(
        self,
        array: MicrophoneArray,
        sources_sx: npt.NDArray[np.float64],
        room: RoomAcoustics,
        rng: np.random.Generator,
        *,
        direct_only: bool = False,
    ) -> npt.NDArray[np.float32]:
        per_source = [self._response(array, source_x, room, rng, direct_only) for source_x in sources_sx]
        return padded_responses(per_source, array.num_microphones)

    def _response(
        self,
        array: MicrophoneArray,
        source_x: npt.NDArray[np.float64],
        room: RoomAcoustics,
        rng: np.random.Generator,
        direct_only: bool,
    ) -> npt.NDArray[np.float32]:
        offset_kx, order_k = image_sources(source_x, room, self._reach_m(room))
        if direct_only:
            offset_kx, order_k = offset_kx[:1], order_k[:1]
        distance_k = np.linalg.norm(offset_kx, axis=-1)
        amplitude_k = (1 - eyring_absorption(room.rt60_s, room.dims_m)) ** (order_k / 2)
        # The direct sound stays whole, however far the source.
        fade_k = np.where(order_k == 0, 1.0, np.cos(_fade(distance_k / self._reach_m(room))))
        early_ml, late = sum_of_arrivals(array, offset_kx, amplitude_k * fade_k)
        if direct_only:
            return early_ml
        tail_ml = self._tail(array, distance_k[1:], amplitude_k[1:], room, late, rng)
        return sum_of_responses(early_ml, tail_ml)

    def _reach_m(self, room: RoomAcoustics) -> float:
        """Returns the radius of a sphere with ``num_reflections`` image sources, one in each volume of a room."""
        return float((3 * self.num_reflections * np.prod(room.dims_m) / (4 * np.pi)) ** (1 / 3))

    def _tail(
        self,
        array: MicrophoneArray,
        distance_k: npt.NDArray[np.float64],
        amplitude_k: npt.NDArray[np.float64],
        room: RoomAcoustics,
        late: int,
        rng: np.random.Generator,
    ) -> npt.NDArray[np.float32]:
        """Returns the tail after K reflections, (M, L), late by ``late`` samples as the early part is."""
        reach_s = self._reach_m(room) / array.speed_of_sound
        first, end = round(FADE_FROM * reach_s * SAMPLE_RATE), round(TAIL_SHARE * room.rt60_s * SAMPLE_RATE)
        if end <= first:
            return np.zeros((array.num_microphones, 0), dtype=np.float32)
        counted_k = distance_k > LEVEL_FROM * self._reach_m(room)
        energy = np.sum((amplitude_k[counted_k] / distance_k[counted_k]) ** 2)
        rate = DECAY_60_DB / room.rt60_s
        span = (np.exp(-rate * LEVEL_FROM * reach_s) - np.exp(-rate * reach_s)) / rate
        time_l = np.arange(first, end) / SAMPLE_RATE
        envelope_l = np.sqrt(energy / span / SAMPLE_RATE * np.exp(-rate * time_l)) * np.sin(_fade(time_l / reach_s))
        tail_ml = diffuse_field(array).draw(end - first, rng) * envelope_l.astype(np.float32)
        return np.pad(tail_ml, ((0, 0), (first + late, 0)))


ROOM_MODELS: dict[str, ImageMethod | ImageMethodWithTail | RayTracing] = {
    model.kind: model for model in (IMAGE_METHOD, ImageMethodWithTail(), RayTracing())
}


def room_model_from_dict(data: dict[str, Any]) -> RoomModel:
    """Builds a model of room acoustics from its entry in a manifest.

    Raises:
        InputError: the kind is unknown, or a setting is out of range.
    """
    if data.get("kind") not in ROOM_MODELS:
        raise InputError(f"acoustics: the kind is {data.get('kind')!r}; known are {', '.join(ROOM_MODELS)}.")
    return replace(ROOM_MODELS[data["kind"]], **{name: value for name, value in data.items() if name != "kind"})


def image_sources(
    source_x: npt.NDArray[np.float64], room: RoomAcoustics, reach_m: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Returns a source and its images up to a distance, in the array's coordinates, (K, 3), and their orders, (K,).

    Args:
        source_x: position of the source in the array's coordinates, (3,), metres. It comes first.
        room: room and place of the array.
        reach_m: greatest distance of images, metres.
    """
    to_room = room.to_room
    inside_x = to_room @ source_x + room.array_position
    offsets, orders = [], []
    for length, place, centre in zip(room.dims_m, inside_x, room.array_position, strict=True):
        most = int(reach_m / (2 * length)) + 1
        turn_n = np.arange(-most, most + 1)
        offsets.append(np.concatenate([2 * turn_n * length + place, 2 * turn_n * length - place]) - centre)
        orders.append(np.concatenate([np.abs(2 * turn_n), np.abs(2 * turn_n - 1)]))
    offset_kx = np.stack(np.meshgrid(*offsets, indexing="ij"), axis=-1).reshape(-1, 3)
    order_k = np.sum(np.stack(np.meshgrid(*orders, indexing="ij")), axis=0).ravel()
    near = ((offset_kx**2).sum(axis=-1) <= reach_m**2) | (order_k == 0)
    offset_kx, order_k = offset_kx[near], order_k[near]
    by_order = np.argsort(order_k, kind="stable")
    return offset_kx[by_order] @ to_room, order_k[by_order]


def _fade(share: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Returns the angle of the crossfade, 0 before it and a quarter turn after it."""
    angle: npt.NDArray[np.float64] = np.pi / 2 * np.clip((share - FADE_FROM) / (1 - FADE_FROM), 0.0, 1.0)
    return angle

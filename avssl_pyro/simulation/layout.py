"""Random layout of a scene before rendering: the room, its people, and which of them speak."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.acoustics.reverberation import RoomAcoustics
from avssl_pyro.simulation.compositing import PersonPosition
from avssl_pyro.simulation.scene_config import MOUTH_HEIGHT, SceneConfig

# Half width of a person, kept clear so that no head is hidden behind a nearer person.
HALF_WIDTH_M = 0.3
PLACING_ATTEMPTS = 1000
# In rooms of random size: attempts for each person, before another room is drawn.
ATTEMPTS_PER_PERSON = 30


@dataclass(frozen=True)
class PersonMetadata:
    """Position and activity of one person.

    Args:
        azimuth: azimuth of head and mouth, radians in [-pi, pi).
        distance_m: distance along the floor, metres.
        height_m: body height, metres.
        mouth_height_m: height of the mouth above the floor, metres.
        mouth_elevation: elevation of the mouth above the camera's horizon, radians.
        speaks: True for a talker.
        level_db: power of the talker's reverberant image relative to the reference; ``None`` if silent.
    """

    azimuth: float
    distance_m: float
    height_m: float
    mouth_height_m: float
    mouth_elevation: float
    speaks: bool
    level_db: float | None

    @property
    def position(self) -> PersonPosition:
        return PersonPosition(self.azimuth, self.distance_m, self.height_m)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values, in degrees and metres."""
        return {
            "azimuth_deg": round(float(np.rad2deg(self.azimuth)), 4),
            "distance_m": round(self.distance_m, 4),
            "height_m": round(self.height_m, 4),
            "mouth_height_m": round(self.mouth_height_m, 4),
            "mouth_elevation_deg": round(float(np.rad2deg(self.mouth_elevation)), 4),
            "speaks": self.speaks,
            "level_db": None if self.level_db is None else round(self.level_db, 4),
        }


@dataclass(frozen=True)
class Layout:
    """The room and the people of one scene.

    Args:
        people: all people of the scene.
        rt60_s: reverberation time, seconds.
        camera_height_m: height of camera and array above the floor, metres.
        room_yaw: azimuth of the room's x axis in the camera's coordinates, radians.
        room_dims_m: length, width and height of the room, metres.
        camera_floor_m: place of the camera along length and width, metres from a corner; None is the middle.
    """

    people: tuple[PersonMetadata, ...]
    rt60_s: float
    camera_height_m: float
    room_yaw: float
    room_dims_m: tuple[float, float, float]
    camera_floor_m: tuple[float, float] | None = None

    @property
    def talkers(self) -> tuple[PersonMetadata, ...]:
        return tuple(person for person in self.people if person.speaks)

    @property
    def room(self) -> RoomAcoustics:
        """The room with the array, which is at the camera's position."""
        return RoomAcoustics(self.room_dims_m, self.rt60_s, self.camera_height_m, self.room_yaw, self.camera_floor_m)

    @property
    def talker_positions_sx(self) -> npt.NDArray[np.float64]:
        """Positions of the talkers' mouths in the camera's coordinates, (S, 3), metres."""
        return np.array(
            [
                (
                    person.distance_m * np.cos(person.azimuth),
                    person.distance_m * np.sin(person.azimuth),
                    person.mouth_height_m - self.camera_height_m,
                )
                for person in self.talkers
            ]
        ).reshape(-1, 3)

    def without_people(self) -> "Layout":
        """Returns the same room without people."""
        return replace(self, people=())


def draw_layout(config: SceneConfig, rng: np.random.Generator) -> Layout:
    """Draws a room, its people, and which of them speak.

    Two people are at least ``min_separation_deg`` apart, and at least the half width of the nearer person (0.3 m, or 31
    degrees at 0.5 m). The middle of every person is thus visible.

    Raises:
        InputError: the people do not fit at this separation.
    """
    num_people = int(rng.choice(config.condition.people))
    if config.condition.talkers is None:
        num_talkers = num_people
    else:
        num_talkers = int(rng.choice([count for count in config.condition.talkers if count <= num_people]))
    camera_height_m = float(rng.uniform(*config.camera_height_range_m))
    if config.room is None:
        places = _around_the_middle(config, num_people, rng)
    else:
        places = _in_a_random_room(config, num_people, camera_height_m, rng)
    azimuths_p, distances_p = places.azimuths_p, places.distances_p
    talkers = set(rng.permutation(num_people)[:num_talkers].tolist())
    people = []
    for person in range(num_people):
        height_m = float(rng.uniform(*config.height_range_m))
        mouth_m = MOUTH_HEIGHT * height_m
        level_db = float(rng.uniform(*config.level_range_db))
        people.append(
            PersonMetadata(
                azimuth=float(azimuths_p[person]),
                distance_m=float(distances_p[person]),
                height_m=height_m,
                mouth_height_m=mouth_m,
                mouth_elevation=float(np.arctan2(mouth_m - camera_height_m, distances_p[person])),
                speaks=person in talkers,
                level_db=level_db if person in talkers else None,
            )
        )
    return Layout(
        people=tuple(people),
        rt60_s=float(rng.uniform(*config.rt60_range_s)),
        camera_height_m=camera_height_m,
        room_yaw=float(rng.uniform(-np.pi, np.pi)) if places.room_yaw is None else places.room_yaw,
        room_dims_m=places.room_dims_m,
        camera_floor_m=places.camera_floor_m,
    )


@dataclass(frozen=True)
class _Places:
    """Places of P people around the camera, and the room; its yaw may be any."""

    azimuths_p: npt.NDArray[np.float64]
    distances_p: npt.NDArray[np.float64]
    room_dims_m: tuple[float, float, float]
    camera_floor_m: tuple[float, float] | None = None
    room_yaw: float | None = None


def _around_the_middle(config: SceneConfig, num_people: int, rng: np.random.Generator) -> _Places:
    for _ in range(PLACING_ATTEMPTS):
        azimuths_p = rng.uniform(-np.pi, np.pi, num_people)
        distances_p = rng.uniform(*config.distance_range_m, num_people)
        if _stand_apart(azimuths_p, distances_p, np.deg2rad(config.min_separation_deg)):
            return _Places(azimuths_p, distances_p, config.room_dims_m)
    raise _too_crowded(config, num_people)


def _in_a_random_room(
    config: SceneConfig, num_people: int, camera_height_m: float, rng: np.random.Generator
) -> _Places:
    """Places people one after the other inside a random room, or in another room where they do not fit."""
    assert config.room is not None
    nearest = config.nearest_m(camera_height_m)
    for _ in range(PLACING_ATTEMPTS):
        dims_m, floor_m = config.room.draw(rng)
        room = RoomAcoustics(dims_m, room_yaw=float(rng.uniform(-np.pi, np.pi)), array_floor_m=floor_m)
        azimuths_p, distances_p = np.zeros(0), np.zeros(0)
        for _ in range(num_people * ATTEMPTS_PER_PERSON):
            if len(azimuths_p) == num_people:
                break
            azimuth, distance = rng.uniform(-np.pi, np.pi), rng.uniform(nearest, config.distance_range_m[1])
            x, y, _z = (
                room.to_room @ (distance * np.cos(azimuth), distance * np.sin(azimuth), 0.0) + room.array_position
            )
            inside = all(HALF_WIDTH_M <= a <= side - HALF_WIDTH_M for a, side in zip((x, y), dims_m, strict=False))
            with_azimuth_p, with_distance_p = np.append(azimuths_p, azimuth), np.append(distances_p, distance)
            if inside and _stand_apart(with_azimuth_p, with_distance_p, np.deg2rad(config.min_separation_deg)):
                azimuths_p, distances_p = with_azimuth_p, with_distance_p
        if len(azimuths_p) == num_people:
            return _Places(azimuths_p, distances_p, dims_m, floor_m, room.room_yaw)
    raise _too_crowded(config, num_people)


def _too_crowded(config: SceneConfig, num_people: int) -> InputError:
    return InputError(
        f"{num_people} people do not fit around the camera {config.min_separation_deg:g} degrees apart; "
        "lower min_separation_deg."
    )


def _stand_apart(
    azimuths_p: npt.NDArray[np.float64], distances_p: npt.NDArray[np.float64], min_separation: float
) -> bool:
    apart_pq = np.abs(wrap_angle(azimuths_p[:, None] - azimuths_p))
    nearer_pq = np.minimum(distances_p[:, None], distances_p)
    wanted_pq = np.maximum(min_separation, np.arctan(HALF_WIDTH_M / nearer_pq))
    np.fill_diagonal(wanted_pq, 0.0)
    return bool((apart_pq >= wanted_pq).all())

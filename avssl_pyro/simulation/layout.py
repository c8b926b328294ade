"""Random layout of a scene before rendering: the room, its people, and which of them speak."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.clip import CLIP_SAMPLES
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.compositing import PersonPosition

# Height of the mouth as a share of body height.
MOUTH_HEIGHT = 0.92
# Half width of a person, kept clear so that no head is hidden behind a nearer person.
HALF_WIDTH_M = 0.3
PLACING_ATTEMPTS = 1000


@dataclass(frozen=True)
class Condition:
    """Numbers of people and of talkers in a scene, both drawn uniformly.

    Args:
        name: value of the command line option.
        people: possible numbers of people.
        talkers: possible numbers of talkers (never more than people); ``None`` if all speak.
    """

    name: str
    people: tuple[int, ...]
    talkers: tuple[int, ...] | None = None


# The two conditions of Sec. IV.
ALL_SPEAK = Condition("all-speak", people=(2, 3))
SOME_SILENT = Condition("some-silent", people=(2, 3, 4), talkers=(2, 3))
CONDITIONS: dict[str, Condition] = {condition.name: condition for condition in (ALL_SPEAK, SOME_SILENT)}


@dataclass(frozen=True)
class SceneConfig:
    """Distribution of scenes; every range is uniform, and the defaults are those of Sec. IV.

    Args:
        condition: numbers of people and talkers.
        level_range_db: power of each talker's reverberant image, averaged over microphones, relative to a reference.
        snr_db: power of the mixture over that of the white Gaussian noise, which is independent between microphones.
        rt60_range_s: reverberation time, seconds.
        distance_range_m: distance of a person from the camera along the floor, metres.
        height_range_m: height of a person, metres.
        min_separation_deg: least angle between two people; greater next to a near person, see :func:`draw_layout`.
        room_dims_m: length, width and height, metres; camera and array are over the middle of the floor.
        camera_height_range_m: height of camera and array, which have the same position, metres.
        peak_range_db: peak of the finished clip relative to full scale.
        num_samples: length of the clip in samples at 16 kHz.

    Raises:
        InputError: the limits of a range are exchanged, or people would stand outside the room.
    """

    condition: Condition = SOME_SILENT
    level_range_db: tuple[float, float] = (-2.5, 2.5)
    snr_db: float = 20.0
    rt60_range_s: tuple[float, float] = (0.2, 0.4)
    distance_range_m: tuple[float, float] = (0.5, 2.0)
    height_range_m: tuple[float, float] = (1.5, 1.9)
    min_separation_deg: float = 20.0
    room_dims_m: tuple[float, float, float] = (5.0, 5.0, 3.0)
    camera_height_range_m: tuple[float, float] = (1.2, 1.5)
    peak_range_db: tuple[float, float] = (-12.0, -1.0)
    num_samples: int = CLIP_SAMPLES

    def __post_init__(self) -> None:
        for name, (low, high) in {
            "level_range_db": self.level_range_db,
            "rt60_range_s": self.rt60_range_s,
            "distance_range_m": self.distance_range_m,
            "height_range_m": self.height_range_m,
            "camera_height_range_m": self.camera_height_range_m,
            "peak_range_db": self.peak_range_db,
        }.items():
            if not low <= high:
                raise InputError(f"{name} is ({low:g}, {high:g}); the first number must not exceed the second.")
        if self.distance_range_m[0] <= 0.2 or self.distance_range_m[1] >= min(self.room_dims_m[:2]) / 2:
            raise InputError(
                f"distance_range_m is {self.distance_range_m}; people must stand more than 0.2 m from the camera and "
                f"inside the room, nearer than {min(self.room_dims_m[:2]) / 2:g} m."
            )
        if max(self.height_range_m[1], self.camera_height_range_m[1]) >= self.room_dims_m[2]:
            raise InputError(f"people and camera must be lower than the room, {self.room_dims_m[2]:g} m.")
        if self.rt60_range_s[0] < 0.1:
            raise InputError(f"rt60_range_s starts at {self.rt60_range_s[0]:g} s; at least 0.1 s is possible here.")
        if self.peak_range_db[1] >= 0.0:
            raise InputError(f"peak_range_db ends at {self.peak_range_db[1]:g} dB; it must stay below full scale, 0.")

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "SceneConfig":
        """Builds a configuration from the values of ``asdict`` after a round trip through JSON."""
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in data.items()
        }
        condition = values["condition"]
        talkers = condition["talkers"]
        values["condition"] = Condition(
            condition["name"], tuple(condition["people"]), None if talkers is None else tuple(talkers)
        )
        return cls(**values)


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
    """

    people: tuple[PersonMetadata, ...]
    rt60_s: float
    camera_height_m: float
    room_yaw: float

    @property
    def talkers(self) -> tuple[PersonMetadata, ...]:
        return tuple(person for person in self.people if person.speaks)

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
    for _ in range(PLACING_ATTEMPTS):
        azimuths_p = rng.uniform(-np.pi, np.pi, num_people)
        distances_p = rng.uniform(*config.distance_range_m, num_people)
        if _stand_apart(azimuths_p, distances_p, np.deg2rad(config.min_separation_deg)):
            break
    else:
        raise InputError(
            f"{num_people} people do not fit around the camera {config.min_separation_deg:g} degrees apart; "
            "lower min_separation_deg."
        )
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
        room_yaw=float(rng.uniform(-np.pi, np.pi)),
    )


def _stand_apart(
    azimuths_p: npt.NDArray[np.float64], distances_p: npt.NDArray[np.float64], min_separation: float
) -> bool:
    apart_pq = np.abs(wrap_angle(azimuths_p[:, None] - azimuths_p))
    nearer_pq = np.minimum(distances_p[:, None], distances_p)
    wanted_pq = np.maximum(min_separation, np.arctan(HALF_WIDTH_M / nearer_pq))
    np.fill_diagonal(wanted_pq, 0.0)
    return bool((apart_pq >= wanted_pq).all())

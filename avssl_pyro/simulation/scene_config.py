"""Distributions of scenes: numbers of people and talkers, rooms, levels, noise and equipment."""

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from avssl_pyro.clip import CLIP_SAMPLES
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.acoustics.models import IMAGE_METHOD, ImageMethodWithTail, RoomModel, room_model_from_dict
from avssl_pyro.simulation.noise import NoiseConfig
from avssl_pyro.validators import at_least, within

# Height of the mouth as a share of body height.
MOUTH_HEIGHT = 0.92
# Settings that manifests leave out at their defaults; sets made before these settings existed have the same manifests.
LATER_SETTINGS = (
    *("room", "noise", "acoustics", "max_elevation_deg", "gain_range_db", "position_error_m", "relight_strength"),
)


@dataclass(frozen=True)
class Condition:
    """Numbers of people and of talkers in a scene, both drawn uniformly.

    Args:
        name: value of the command line option.
        people: possible numbers of people; repeated numbers are drawn more often.
        talkers: possible numbers of talkers (never more than people); ``None`` if all speak.
    """

    name: str
    people: tuple[int, ...]
    talkers: tuple[int, ...] | None = None


# The two conditions of Sec. IV.
ALL_SPEAK = Condition("all-speak", people=(2, 3))
SOME_SILENT = Condition("some-silent", people=(2, 3, 4), talkers=(2, 3))
# About one scene in six has no talker.
WIDE = Condition(
    "wide",
    people=(0, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 5, 5),
    talkers=(0, 1, 1, 1, 1, 2, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4),
)


@dataclass(frozen=True)
class RoomRange:
    """Distribution of rooms and of the array's place in them.

    Args:
        side_range_m: length and width, each log-uniform, metres.
        height_range_m: height, uniform, metres.
        wall_margin_m: least distance of the array from the walls, uniform over the rest of the floor, metres.

    Raises:
        InputError: the limits of a range are exchanged, or the array does not fit between the walls.
    """

    side_range_m: tuple[float, float] = (2.5, 15.0)
    height_range_m: tuple[float, float] = (2.3, 5.0)
    wall_margin_m: float = 0.5

    def __post_init__(self) -> None:
        for name, (low, high) in {"side_range_m": self.side_range_m, "height_range_m": self.height_range_m}.items():
            if not 0.0 < low <= high:
                raise InputError(
                    f"{name} is ({low:g}, {high:g}); both must be positive, and the first must not exceed the second."
                )
        within(0.0, self.side_range_m[0] / 2).check(self, "wall_margin_m")

    def draw(self, rng: np.random.Generator) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Draws length, width and height, and the array's place along length and width, metres."""
        low, high = self.side_range_m
        length, width = np.exp(rng.uniform(np.log(low), np.log(high), size=2)).tolist()
        height = float(rng.uniform(*self.height_range_m))
        x, y = (float(rng.uniform(self.wall_margin_m, side - self.wall_margin_m)) for side in (length, width))
        return (length, width, height), (x, y)


@dataclass(frozen=True)
class SceneConfig:
    """Distribution of scenes; every range is uniform, and the defaults are those of Sec. IV.

    Simulated recordings use the settings up to ``num_samples`` alone.

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
        room: distribution of rooms and places in them, instead of ``room_dims_m``; None is that one room.
        noise: distribution of the noise, instead of white noise at ``snr_db``; None is that noise.
        acoustics: model of the room's reverberation.
        max_elevation_deg: greatest elevation of a mouth above or below the camera's horizon, with ``room`` only.
        gain_range_db: gain of each channel, drawn for every scene.
        position_error_m: greatest deviation of each coordinate of a microphone, drawn for every scene; arrays in free
            field only.
        relight_strength: strength of random lighting, see :func:`.relight`.

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
    room: RoomRange | None = None
    noise: NoiseConfig | None = None
    acoustics: RoomModel = IMAGE_METHOD
    max_elevation_deg: float = 90.0
    gain_range_db: tuple[float, float] = (0.0, 0.0)
    position_error_m: float = 0.0
    relight_strength: float = 1.0

    def __post_init__(self) -> None:
        for name, (low, high) in {
            "level_range_db": self.level_range_db,
            "rt60_range_s": self.rt60_range_s,
            "distance_range_m": self.distance_range_m,
            "height_range_m": self.height_range_m,
            "camera_height_range_m": self.camera_height_range_m,
            "peak_range_db": self.peak_range_db,
            "gain_range_db": self.gain_range_db,
        }.items():
            if not low <= high:
                raise InputError(f"{name} is ({low:g}, {high:g}); the first number must not exceed the second.")
        self._check_people_in_room()
        if self.rt60_range_s[0] < 0.1:
            raise InputError(f"rt60_range_s starts at {self.rt60_range_s[0]:g} s; at least 0.1 s is possible here.")
        if self.peak_range_db[1] >= 0.0:
            raise InputError(f"peak_range_db ends at {self.peak_range_db[1]:g} dB; it must stay below full scale, 0.")
        at_least(0.0).check(self, "position_error_m", "relight_strength")
        within(1.0, 90.0).check(self, "max_elevation_deg")

    def _check_people_in_room(self) -> None:
        lowest = self.room_dims_m[2] if self.room is None else self.room.height_range_m[0]
        if max(self.height_range_m[1], self.camera_height_range_m[1]) >= lowest:
            raise InputError(f"people and camera must be lower than the room, {lowest:g} m.")
        nearest, farthest = self.distance_range_m
        if nearest <= 0.2 or (self.room is None and farthest >= min(self.room_dims_m[:2]) / 2):
            inside = "" if self.room is not None else f", nearer than {min(self.room_dims_m[:2]) / 2:g} m"
            raise InputError(
                f"distance_range_m is {self.distance_range_m}; people must stand more than 0.2 m from the camera and "
                f"inside the room{inside}."
            )
        needed = max(self.nearest_m(camera_height_m) for camera_height_m in self.camera_height_range_m)
        if self.room is not None and needed >= farthest:
            raise InputError(
                f"distance_range_m ends at {farthest:g} m, but mouths are within {self.max_elevation_deg:g} degrees of "
                f"the horizon only beyond {needed:.2f} m; raise max_elevation_deg or the distance."
            )

    def nearest_m(self, camera_height_m: float) -> float:
        """Returns the least distance at which no mouth is above ``max_elevation_deg``, or that of the range, metres."""
        rise_m = max(abs(MOUTH_HEIGHT * height_m - camera_height_m) for height_m in self.height_range_m)
        return max(self.distance_range_m[0], float(rise_m / np.tan(np.deg2rad(self.max_elevation_deg))))

    def to_dict(self) -> dict[str, Any]:
        """Returns plain values for a manifest, without later settings at their defaults."""
        data = asdict(self)
        for setting in fields(self):
            if setting.name in LATER_SETTINGS and getattr(self, setting.name) == setting.default:
                del data[setting.name]
        return data

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "SceneConfig":
        """Builds a configuration from the values of :meth:`to_dict` after a round trip through JSON."""
        values = _with_tuples(data)
        for name, part in (("room", RoomRange), ("noise", NoiseConfig)):
            if values.get(name) is not None:
                values[name] = part(**_with_tuples(values[name]))
        if "acoustics" in values:
            values["acoustics"] = room_model_from_dict(values["acoustics"])
        condition = values["condition"]
        talkers = condition["talkers"]
        values["condition"] = Condition(
            condition["name"], tuple(condition["people"]), None if talkers is None else tuple(talkers)
        )
        return cls(**values)


def _with_tuples(data: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in data.items()}


# Scenes for training of networks that are used in other rooms than the simulated ones.
WIDE_SCENES = SceneConfig(
    condition=WIDE,
    level_range_db=(-5.0, 5.0),
    rt60_range_s=(0.15, 1.0),
    distance_range_m=(0.5, 5.0),
    min_separation_deg=15.0,
    camera_height_range_m=(0.3, 2.2),
    room=RoomRange(),
    noise=NoiseConfig(),
    acoustics=ImageMethodWithTail(),
    max_elevation_deg=50.0,
    gain_range_db=(-3.0, 3.0),
    position_error_m=0.003,
    relight_strength=1.8,
)
SCENE_CONFIGS: dict[str, SceneConfig] = {
    config.condition.name: config
    for config in (SceneConfig(condition=ALL_SPEAK), SceneConfig(condition=SOME_SILENT), WIDE_SCENES)
}

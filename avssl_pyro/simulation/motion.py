"""Random trajectories and activity of people around an array: talkers and silent people, walking or standing."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.acoustics.reverberation import RoomAcoustics
from avssl_pyro.simulation.scene_config import MOUTH_HEIGHT, SceneConfig


@dataclass(frozen=True)
class MovingTalkersConfig:
    """Distribution of trajectories and utterances; every range is uniform.

    Args:
        num_talkers: least and greatest number of talkers.
        seconds, step_s: duration, and time between two instants of the result.
        speed_deg_s: angular speed of a walking talker in either direction.
        walk_s, rest_s: durations of walks and rests, which alternate.
        utterance_s, pause_s: durations of utterances and pauses, which alternate.
        apart_deg: least angle between talkers at the first instant; later they may pass each other.
    """

    num_talkers: tuple[int, int] = (1, 3)
    seconds: float = 60.0
    step_s: float = 0.1
    speed_deg_s: tuple[float, float] = (2.0, 20.0)
    walk_s: tuple[float, float] = (1.0, 4.0)
    rest_s: tuple[float, float] = (1.0, 5.0)
    utterance_s: tuple[float, float] = (0.8, 4.0)
    pause_s: tuple[float, float] = (0.3, 1.5)
    apart_deg: float = 30.0


@dataclass(frozen=True)
class MovingTalkers:
    """True azimuths and activity of S talkers at T instants.

    Args:
        times_s: instants, (T,).
        azimuths_st: azimuths of the talkers, (S, T), radians.
        sounding_st: activity of the talkers, (S, T).
    """

    times_s: npt.NDArray[np.float64]
    azimuths_st: npt.NDArray[np.float64]
    sounding_st: npt.NDArray[np.bool_]

    def window(self, t: int) -> dict[int, float]:
        """Azimuths of the talkers active at instant t, radians, by talker number."""
        return {int(s): float(self.azimuths_st[s, t]) for s in np.flatnonzero(self.sounding_st[:, t])}


def draw_moving_talkers(config: MovingTalkersConfig, rng: np.random.Generator) -> MovingTalkers:
    """Draws the talkers of one recording."""
    times_t = np.arange(round(config.seconds / config.step_s), dtype=np.float64) * config.step_s
    count = int(rng.integers(config.num_talkers[0], config.num_talkers[1] + 1))
    # Every gap gets the least angle; the rest of the circle is divided among them at random.
    slack = 360.0 - count * config.apart_deg
    gaps_s = config.apart_deg + slack * rng.dirichlet(np.ones(count))
    starts_s = np.deg2rad(rng.uniform(0, 360) + np.cumsum(gaps_s))
    azimuths_st = np.array([start + _walk(config, times_t, rng) for start in starts_s])
    talking_st = [
        _alternate(
            times_t, lambda: (rng.uniform(*config.utterance_s), 1.0), lambda: (rng.uniform(*config.pause_s), 0.0), rng
        )
        for _ in starts_s
    ]
    return MovingTalkers(times_t, wrap_angle(azimuths_st), np.array(talking_st) > 0)


@dataclass(frozen=True)
class MovingPeopleConfig:
    """Distribution of the people of a recording; every range is uniform.

    Args:
        people: least and greatest number of people.
        talkers: least and greatest number of talkers, limited by the number of people.
        standing_share: probability that a person never walks.
        walks: trajectories, utterances and pauses; its ``num_talkers`` is not used.
        scenes: room, heights of people and camera, reverberation, levels and noise.
        distance_range_m: constant distance of a person from the camera along the floor.

    Raises:
        InputError: the recording is shorter than one second.
    """

    people: tuple[int, int] = (3, 4)
    talkers: tuple[int, int] = (2, 3)
    standing_share: float = 0.4
    walks: MovingTalkersConfig = field(
        default_factory=lambda: MovingTalkersConfig(utterance_s=(1.5, 5.0), pause_s=(0.5, 4.0))
    )
    scenes: SceneConfig = field(default_factory=SceneConfig)
    distance_range_m: tuple[float, float] = (0.8, 2.0)

    def __post_init__(self) -> None:
        if not self.walks.seconds >= 1.0:
            raise InputError(f"a recording of {self.walks.seconds:g} s is too short; give at least 1.")


@dataclass(frozen=True)
class MovingPeople:
    """The people of a recording, talkers first.

    Args:
        talkers: azimuths of all people, and turns of the talkers; silent people have none.
        distances_s, heights_s: distances along the floor and body heights, (S,), metres.
        levels_s: power of each voice at the array, (S,), dB relative to a common reference.
        room: the room around them.
    """

    talkers: MovingTalkers
    distances_s: npt.NDArray[np.float64]
    heights_s: npt.NDArray[np.float64]
    levels_s: npt.NDArray[np.float64]
    room: RoomAcoustics

    @property
    def mouths_above_s(self) -> npt.NDArray[np.float64]:
        """Heights of the mouths above the array, (S,), metres."""
        return MOUTH_HEIGHT * self.heights_s - self.room.array_height_m

    @property
    def elevations_s(self) -> npt.NDArray[np.float64]:
        """Elevations of the mouths, (S,), radians."""
        return np.arctan2(self.mouths_above_s, self.distances_s)

    def azimuths_at(self, times_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Azimuths (S, T) at any times in seconds, interpolated linearly; radians in [-pi, pi)."""
        unwrapped_st = np.unwrap(self.talkers.azimuths_st, axis=1)
        return wrap_angle([np.interp(times_s, self.talkers.times_s, azimuth_t) for azimuth_t in unwrapped_st])


def draw_moving_people(config: MovingPeopleConfig, rng: np.random.Generator) -> MovingPeople:
    """Draws the room and the people of one recording."""
    count = int(rng.integers(config.people[0], config.people[1] + 1))
    talking = min(count, int(rng.integers(config.talkers[0], config.talkers[1] + 1)))
    everybody = draw_moving_talkers(replace(config.walks, num_talkers=(count, count)), rng)
    stands_s = rng.uniform(size=count) < config.standing_share
    azimuths_st = np.where(stands_s[:, None], everybody.azimuths_st[:, :1], everybody.azimuths_st)
    sounding_st = everybody.sounding_st & (np.arange(count) < talking)[:, None]
    # Azimuths are drawn in order around the circle; talkers and silent people must be mixed.
    azimuths_st = azimuths_st[rng.permutation(count)]
    scenes = config.scenes
    return MovingPeople(
        talkers=MovingTalkers(everybody.times_s, azimuths_st, sounding_st),
        distances_s=rng.uniform(*config.distance_range_m, count),
        heights_s=rng.uniform(*scenes.height_range_m, count),
        levels_s=rng.uniform(*scenes.level_range_db, count),
        room=RoomAcoustics(
            scenes.room_dims_m,
            float(rng.uniform(*scenes.rt60_range_s)),
            float(rng.uniform(*scenes.camera_height_range_m)),
            float(rng.uniform(-np.pi, np.pi)),
        ),
    )


# Draws the duration (seconds) and the value of one segment.
_DrawSegment = Callable[[], tuple[float, float]]


def _walk(
    config: MovingTalkersConfig, times_t: npt.NDArray[np.float64], rng: np.random.Generator
) -> npt.NDArray[np.float64]:
    """Azimuth relative to the first instant, (T,), radians."""

    def walk() -> tuple[float, float]:
        return rng.uniform(*config.walk_s), float(rng.choice([-1, 1]) * np.deg2rad(rng.uniform(*config.speed_deg_s)))

    velocity_t = _alternate(times_t, walk, lambda: (rng.uniform(*config.rest_s), 0.0), rng)
    moved: npt.NDArray[np.float64] = np.concatenate([[0.0], np.cumsum(velocity_t[:-1]) * config.step_s])
    return moved


def _alternate(
    times_t: npt.NDArray[np.float64], one: _DrawSegment, other: _DrawSegment, rng: np.random.Generator
) -> npt.NDArray[np.float64]:
    """Piecewise constant values, (T,), of two kinds of segments that alternate; either kind may be first."""
    values_t = np.zeros(len(times_t))
    kinds = [one, other] if rng.uniform() < 0.5 else [other, one]
    begin, turn = 0.0, 0
    while begin <= times_t[-1]:
        length, value = kinds[turn % 2]()
        values_t[times_t >= begin] = value
        begin, turn = begin + length, turn + 1
    return values_t

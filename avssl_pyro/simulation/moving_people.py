"""Who is in a recording: people who walk around camera and array or stand, who talk or keep silent."""

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.layout import MOUTH_HEIGHT, SceneConfig
from avssl_pyro.simulation.moving_source import RoomAcoustics
from avssl_pyro.simulation.moving_talkers import MovingTalkers, MovingTalkersConfig, draw_moving_talkers


@dataclass(frozen=True)
class MovingPeopleConfig:
    """What is drawn; ranges are of uniform distributions.

    Args:
        people: least and most people.
        talkers: least and most people who talk; never more than there are.
        standing_share: of the people, by chance, who never walk.
        walks: how the others walk, and how those who talk speak and pause; its numbers of talkers are not used.
        scenes: room, heights of people and camera, reverberation, levels and noise.
        distance_range_m: from the camera to a person along the floor, who keeps it.
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
    """The people of a recording, those who talk first.

    Args:
        talkers: where everybody is, and when each may talk; the silent ones never do.
        distances_s, heights_s: of the people, metres.
        levels_s: power of each voice at the array, dB about a reference.
        room: where they are.
    """

    talkers: MovingTalkers
    distances_s: npt.NDArray[np.float64]
    heights_s: npt.NDArray[np.float64]
    levels_s: npt.NDArray[np.float64]
    room: RoomAcoustics

    @property
    def mouths_above_s(self) -> npt.NDArray[np.float64]:
        """Height of the mouths above the array, metres."""
        return MOUTH_HEIGHT * self.heights_s - self.room.array_height_m

    @property
    def elevations_s(self) -> npt.NDArray[np.float64]:
        """Of the mouths, radians."""
        return np.arctan2(self.mouths_above_s, self.distances_s)

    def azimuths_at(self, times_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Azimuths (S, T) at any times, seconds, between the instants evenly; radians in [-pi, pi)."""
        unwrapped_st = np.unwrap(self.talkers.azimuths_st, axis=1)
        return wrap_angle([np.interp(times_s, self.talkers.times_s, azimuth_t) for azimuth_t in unwrapped_st])


def draw_moving_people(config: MovingPeopleConfig, rng: np.random.Generator) -> MovingPeople:
    """Draws a recording's room and people."""
    count = int(rng.integers(config.people[0], config.people[1] + 1))
    talking = min(count, int(rng.integers(config.talkers[0], config.talkers[1] + 1)))
    everybody = draw_moving_talkers(replace(config.walks, num_talkers=(count, count)), rng)
    stands_s = rng.uniform(size=count) < config.standing_share
    azimuths_st = np.where(stands_s[:, None], everybody.azimuths_st[:, :1], everybody.azimuths_st)
    sounding_st = everybody.sounding_st & (np.arange(count) < talking)[:, None]
    # Places come in order around the circle; talkers and silent people are to be mixed.
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

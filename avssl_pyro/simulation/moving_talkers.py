"""Talkers who walk around the array, rest, speak and pause: where each is, and when it sounds."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.grid import wrap_angle


@dataclass(frozen=True)
class MovingTalkersConfig:
    """What is drawn; ranges are of uniform distributions.

    Args:
        num_talkers: least and most talkers.
        seconds, step_s: length, and time between the instants of the result.
        speed_deg_s: of a walking talker, either way.
        walk_s, rest_s: lengths of walks and rests, which take turns.
        utterance_s, pause_s: lengths of utterances and the pauses between them.
        apart_deg: least angle between talkers at the beginning; later they may pass each other.
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
    """The truth.

    Args:
        times_s: the instants, (T,).
        azimuths_st: of the talkers, (S, T), radians.
        sounding_st: who speaks, (S, T).
    """

    times_s: npt.NDArray[np.float64]
    azimuths_st: npt.NDArray[np.float64]
    sounding_st: npt.NDArray[np.bool_]

    def window(self, t: int) -> dict[int, float]:
        """Who sounds at instant t, by number, and where."""
        return {int(s): float(self.azimuths_st[s, t]) for s in np.flatnonzero(self.sounding_st[:, t])}


def draw_moving_talkers(config: MovingTalkersConfig, rng: np.random.Generator) -> MovingTalkers:
    """Draws a recording's talkers."""
    times_t = np.arange(round(config.seconds / config.step_s)) * config.step_s
    count = int(rng.integers(config.num_talkers[0], config.num_talkers[1] + 1))
    # Equal gaps of at least the least angle share what is left of the circle at random.
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


Stretch = Callable[[], tuple[float, float]]


def _walk(
    config: MovingTalkersConfig, times_t: npt.NDArray[np.float64], rng: np.random.Generator
) -> npt.NDArray[np.float64]:
    """Azimuth relative to the first instant, radians."""

    def walk() -> tuple[float, float]:
        return rng.uniform(*config.walk_s), float(rng.choice([-1, 1]) * np.deg2rad(rng.uniform(*config.speed_deg_s)))

    velocity_t = _alternate(times_t, walk, lambda: (rng.uniform(*config.rest_s), 0.0), rng)
    moved: npt.NDArray[np.float64] = np.concatenate([[0.0], np.cumsum(velocity_t[:-1]) * config.step_s])
    return moved


def _alternate(
    times_t: npt.NDArray[np.float64], one: Stretch, other: Stretch, rng: np.random.Generator
) -> npt.NDArray[np.float64]:
    """Values over time of two kinds of stretches (length in seconds, value) that take turns; either may be first."""
    values_t = np.zeros(len(times_t))
    kinds = [one, other] if rng.uniform() < 0.5 else [other, one]
    begin, turn = 0.0, 0
    while begin <= times_t[-1]:
        length, value = kinds[turn % 2]()
        values_t[times_t >= begin] = value
        begin, turn = begin + length, turn + 1
    return values_t

import numpy as np
import pytest

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.simulation.motion import MovingTalkers, MovingTalkersConfig, draw_moving_talkers

CONFIG = MovingTalkersConfig(num_talkers=(2, 4), seconds=40.0)


def drawn(seed: int) -> MovingTalkers:
    return draw_moving_talkers(CONFIG, np.random.default_rng(seed))


def lengths(values_t: np.ndarray) -> np.ndarray:
    """Of the stretches of equal values, without the first and the last, which the recording cuts."""
    edges = np.flatnonzero(np.diff(values_t))
    return np.diff(edges)


@pytest.mark.parametrize("seed", range(5))
def test_talkers_walk_and_rest_at_speeds_that_were_asked_for(seed: int) -> None:
    talkers = drawn(seed)
    assert 2 <= len(talkers.azimuths_st) <= 4
    speed_st = np.rad2deg(np.abs(wrap_angle(np.diff(talkers.azimuths_st)))) / CONFIG.step_s
    walks = speed_st > 1e-6
    assert speed_st[walks].min() > CONFIG.speed_deg_s[0] - 1e-6
    assert speed_st.max() < CONFIG.speed_deg_s[1] + 1e-6
    assert 0.1 < walks.mean() < 0.9


@pytest.mark.parametrize("seed", range(5))
def test_pauses_and_utterances_last_as_long_as_asked_for(seed: int) -> None:
    for sounding_t in drawn(seed).sounding_st:
        seconds = lengths(sounding_t.astype(int)) * CONFIG.step_s
        first_silent = bool(sounding_t[np.flatnonzero(np.diff(sounding_t.astype(int)))[0] + 1])
        utterances, pauses = (seconds[0::2], seconds[1::2]) if first_silent else (seconds[1::2], seconds[0::2])
        # A stretch of a given length covers one instant more or less.
        assert pauses.min() > 0.3 - 0.15
        assert pauses.max() < 1.5 + 0.15
        assert utterances.min() > 0.8 - 0.15
        assert utterances.max() < 4.0 + 0.15


@pytest.mark.parametrize("seed", range(5))
def test_talkers_begin_apart(seed: int) -> None:
    start_s = np.sort(drawn(seed).azimuths_st[:, 0])
    gaps_s = np.diff([*start_s, start_s[0] + 2 * np.pi])
    assert np.rad2deg(gaps_s).min() > CONFIG.apart_deg - 1e-6


def test_windows_hold_those_who_sound() -> None:
    talkers = drawn(0)
    for t in (0, 57):
        assert talkers.window(t) == {
            s: talkers.azimuths_st[s, t] for s in range(len(talkers.azimuths_st)) if talkers.sounding_st[s, t]
        }

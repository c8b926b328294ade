from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.errors import InputError
from avssl_pyro.localization.posterior import LocalizedSource
from avssl_pyro.tracking.multi_target import MultiTargetConfig
from avssl_pyro.tracking.online import OnlineTracker
from avssl_pyro.tracking.tracker import Track, TrackedSource, TrackingConfig, WindowDetections, track, tracked_sources

STEP_S = 0.1
Path = Callable[[float], float]


def source(azimuth_deg: float, level: float = 0.4) -> LocalizedSource:
    return LocalizedSource(float(wrap_angle(np.deg2rad(azimuth_deg))), np.deg2rad(2.0), level, 0.01, level, 0)


def record(
    paths: Sequence[Path], num_windows: int, silent: Sequence[set[int]] = (), std_deg: float = 2.0, seed: int = 0
) -> list[WindowDetections]:
    """Windows in which every talker is found at its path (degrees of seconds), but where it is silent."""
    rng = np.random.default_rng(seed)
    windows = []
    for t in range(num_windows):
        talking = [path for s, path in enumerate(paths) if s >= len(silent) or t not in silent[s]]
        found = tuple(source(path(t * STEP_S) + std_deg * rng.standard_normal()) for path in talking)
        windows.append(WindowDetections(t * STEP_S, found))
    return windows


def errors_deg(found: Track, path: Path) -> np.ndarray:
    truth = np.deg2rad([path(time_s) for time_s in found.times_s])
    return np.rad2deg(np.abs(wrap_angle(found.azimuths - truth)))


def still(time_s: float) -> float:
    return 40.0


def sounding_ids(windows: Sequence[WindowDetections], tracks: Sequence[Track]) -> list[set[int]]:
    return [{found.track_id for found in window} for window in tracked_sources(windows, tracks)]


def test_one_missed_window_is_bridged() -> None:
    windows = record([still], 30, silent=[{12}])
    tracks = track(windows)
    assert sounding_ids(windows, tracks) == [{0}] * 30
    assert errors_deg(tracks[0], still).max() < 4.0
    assert tracks[0].levels[12] == pytest.approx(0.4)


def test_pause_of_five_windows_is_silent_and_the_same_source_after_it() -> None:
    pause = set(range(20, 25))
    windows = record([still], 50, silent=[pause])
    tracks = track(windows)
    ids = sounding_ids(windows, tracks)
    assert len(tracks) == 1
    assert [ids[t] for t in range(50) if t not in pause] == [{0}] * 45
    assert [ids[t] for t in sorted(pause)] == [set()] * 5
    assert (tracks[0].presence[20:25] > 0.9).all()


def test_who_speaks_after_the_memory_has_run_out_is_somebody_new() -> None:
    windows = record([still], 90, silent=[set(range(30, 60))])
    forgetful = TrackingConfig(bank=MultiTargetConfig(memory_s=2.0))
    patient = TrackingConfig(bank=MultiTargetConfig(memory_s=4.0))
    assert [(one.start_s, one.end_s) for one in track(windows, forgetful)] == [
        pytest.approx((0.0, 2.9)),
        pytest.approx((6.0, 8.9)),
    ]
    assert len(track(windows, patient)) == 1


def test_talker_who_walks_across_the_seam_stays_one_source() -> None:
    def path(time_s: float) -> float:
        return 150.0 + 15.0 * time_s

    windows = record([path], 60)
    (found,) = track(windows)
    assert len(found.times_s) == 60
    assert errors_deg(found, path).max() < 6.0
    assert (np.abs(found.azimuths) <= np.pi).all()


@pytest.mark.parametrize("seed", range(3))
def test_two_talkers_who_pass_each_other_keep_their_identities(seed: int) -> None:
    def left(time_s: float) -> float:
        return -40.0 + 12.0 * time_s

    def right(time_s: float) -> float:
        return 40.0 - 12.0 * time_s

    windows = record([left, right], 70, seed=seed)
    # The localizer merges what is closer than 12 degrees.
    windows = [
        replace(window, sources=(source(0.0, 0.8),)) if abs(left(window.time_s) - right(window.time_s)) < 12 else window
        for window in windows
    ]
    tracks = track(windows)
    assert len(tracks) == 2
    ends = {round(float(np.rad2deg(one.azimuths[0]))) > 0: float(np.rad2deg(one.azimuths[-1])) for one in tracks}
    assert ends[False] == pytest.approx(left(6.9), abs=6.0)
    assert ends[True] == pytest.approx(right(6.9), abs=6.0)


def test_talker_who_stops_beside_another_does_not_swallow_it() -> None:
    windows = record([still, lambda _: 60.0], 60, silent=[set(range(30, 60)), set(range(30))])
    tracks = track(windows)
    assert [round(float(np.rad2deg(one.azimuths.mean())), -1) for one in tracks] == [40.0, 60.0]


def test_clutter_makes_no_tracks() -> None:
    rng = np.random.default_rng(0)
    windows = [
        WindowDetections(t * STEP_S, tuple(source(rng.uniform(-180, 180), 0.1) for _ in range(rng.poisson(0.2))))
        for t in range(300)
    ]
    assert sum(len(window.sources) for window in windows) > 40
    assert track(windows) == ()


def test_clutter_beside_a_talker_stays_out_of_its_track() -> None:
    windows = record([still], 40)
    windows[20] = replace(windows[20], sources=(*windows[20].sources, source(90.0), source(70.0)))
    (found,) = track(windows)
    assert errors_deg(found, still).max() < 4.0


@pytest.mark.parametrize(("seconds", "speed"), [(1.0, 10.0), (3.0, 15.0)])
def test_two_tracks_on_one_talker_become_one(seconds: float, speed: float) -> None:
    # At first found twice; then the second detection settles on the talker as well.
    windows = record([still], 80)
    for t in range(round(seconds / STEP_S)):
        double = source(42.0 + speed * (seconds - t * STEP_S))
        windows[t] = replace(windows[t], sources=(*windows[t].sources, double))
    ids = sounding_ids(windows, track(windows))
    assert all(len(found) == 1 for found in ids[55:])


def test_slow_windows_and_gaps_are_followed() -> None:
    times_s = [0.0, 0.5, 1.0, 1.5, 3.0, 3.5, 4.0, 4.5]
    windows = [WindowDetections(time_s, (source(10 + 8 * time_s),)) for time_s in times_s]
    (found,) = track(windows)
    assert found.times_s.tolist() == times_s
    assert errors_deg(found, lambda time_s: 10 + 8 * time_s).max() < 6.0


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 71))
def test_turning_the_world_turns_the_tracks(cells: int) -> None:
    windows = record([still, lambda time_s: 120 + 10 * time_s], 25, silent=[{5, 6}])
    turn = 2 * np.pi * cells / 72
    turned = [
        replace(
            window,
            sources=tuple(replace(one, azimuth=float(wrap_angle(one.azimuth + turn))) for one in window.sources),
        )
        for window in windows
    ]
    for one, other in zip(track(windows), track(turned), strict=True):
        np.testing.assert_allclose(wrap_angle(other.azimuths - one.azimuths - turn), 0.0, atol=1e-6)
        np.testing.assert_allclose(other.presence, one.presence, atol=1e-6)


def test_nothing_heard_is_no_track() -> None:
    assert track([]) == ()
    assert track([WindowDetections(0.0, ())]) == ()
    assert tracked_sources([WindowDetections(0.0, ())], ()) == ((),)


@pytest.mark.parametrize(
    ("windows", "message"),
    [
        ([WindowDetections(1.0, ()), WindowDetections(1.0, ())], "window 1 is at 1.0 s"),
        ([WindowDetections(float("nan"), ())], "window 0 is at nan s"),
        ([WindowDetections(0.0, (replace(source(0.0), azimuth=float("inf")),))], "azimuth inf"),
    ],
)
def test_what_makes_no_sense_is_refused(windows: list[WindowDetections], message: str) -> None:
    with pytest.raises(InputError, match=message):
        track(windows)


def live(windows: Sequence[WindowDetections], lag: int) -> list[tuple[TrackedSource, ...]]:
    tracker = OnlineTracker(step_s=STEP_S, lag=lag)
    answers = [tracker.update(window) for window in windows]
    assert [answer is None for answer in answers] == [t < lag for t in range(len(windows))]
    return [answer for answer in answers if answer is not None] + tracker.finish()


def test_live_tracks_bridge_a_miss_and_keep_their_identity_through_a_pause() -> None:
    windows = record([still, lambda _: -90.0], 50, silent=[{12}, set(range(30, 35))])
    answers = live(windows, lag=3)
    assert len(answers) == 50
    by_id = [{found.track_id: round(float(np.rad2deg(found.azimuth)), -1) for found in answer} for answer in answers]
    assert [by_id[t] for t in (5, 12, 29, 40, 49)] == [by_id[0]] * 5
    assert sorted(by_id[0].values()) == [-90.0, 40.0]
    assert len(by_id[33]) == 1


def test_live_tracks_that_may_wait_for_everything_are_those_of_the_whole_recording() -> None:
    windows = record([still, lambda time_s: 100 + 10 * time_s], 20, silent=[{7}])
    whole = tracked_sources(windows, track(windows))
    for answer, expected in zip(live(windows, lag=19), whole, strict=True):
        azimuths, expected_azimuths = (sorted(one.azimuth for one in found) for found in (answer, expected))
        np.testing.assert_allclose(azimuths, expected_azimuths, atol=1e-9)


def test_live_tracker_remembers_no_more_than_its_lag() -> None:
    tracker = OnlineTracker(step_s=STEP_S, lag=2)
    for window in record([still], 60):
        tracker.update(window)
    assert [len(chain.steps) for chain in tracker._bank.active] == [3]
    assert tracker._bank.ended == []


def test_a_lag_or_step_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(InputError, match="lag of -1"):
        OnlineTracker(lag=-1)

import numpy as np
import pytest

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.benchmarks.tracking import (
    DetectorConfig,
    SimulatedRecordings,
    alone,
    compare_links,
    draw_detections,
    nearest,
)
from avssl_pyro.localization.posterior import LocalizedSource
from avssl_pyro.simulation.motion import MovingTalkersConfig, draw_moving_talkers
from avssl_pyro.tracking.tracker import TrackingConfig, WindowDetections

TOLERANCE = float(np.deg2rad(10))


def window(time_s: float, *azimuths_deg: float) -> WindowDetections:
    found = tuple(LocalizedSource(float(np.deg2rad(one)), 0.03, 0.3, 0.01, 0.3, 0) for one in azimuths_deg)
    return WindowDetections(time_s, found)


def test_tracking_raises_f_and_lowers_identity_switches() -> None:
    simulated = SimulatedRecordings(MovingTalkersConfig(seconds=20.0), count=2, seed=5)
    scores = compare_links([simulated.draw(index) for index in range(2)], TrackingConfig(), TOLERANCE, lag=3)
    single, linked, live, whole = scores.values()
    assert single.f_measure + 0.01 < live.f_measure
    assert single.f_measure + 0.03 < whole.f_measure
    assert whole.switches < 0.2 * linked.switches
    assert live.switches < 0.2 * linked.switches
    assert whole.fragments < 0.5 * single.fragments


def test_recordings_depend_on_seed_and_index_alone() -> None:
    simulated = SimulatedRecordings(MovingTalkersConfig(seconds=5.0), count=3, seed=1)
    assert simulated.draw(2) == simulated.draw(2)
    assert simulated.draw(2) != simulated.draw(1)


def test_identities_of_windows_alone_are_places_in_a_list() -> None:
    assert alone([window(0.0, 10.0, 90.0), window(0.1, 91.0)]) == [
        {0: pytest.approx(np.deg2rad(10)), 1: pytest.approx(np.deg2rad(90))},
        {0: pytest.approx(np.deg2rad(91))},
    ]


def test_nearest_links_across_the_seam_and_starts_anew_after_a_miss() -> None:
    windows = [window(0.0, 179.0, 0.0), window(0.1, 3.0, -178.0), window(0.2, 4.0), window(0.3, -178.0, 5.0)]
    assert [sorted(one) for one in nearest(windows, TOLERANCE)] == [[0, 1], [0, 1], [1], [1, 2]]


def test_drawn_detections_have_the_errors_misses_and_clutter_asked_for() -> None:
    rng = np.random.default_rng(0)
    talkers = draw_moving_talkers(MovingTalkersConfig(num_talkers=(1, 1), seconds=200.0), rng)
    config = DetectorConfig(std_deg=3.0, miss=0.2, clutter=0.1)
    truths = [talkers.window(t) for t in range(2000)]
    errors_deg, clutter, hits = [], 0, 0
    for truth, found in zip(truths, draw_detections(talkers, config, rng), strict=True):
        offsets_deg = [
            float(np.rad2deg(wrap_angle(source.azimuth - truth[0]))) if truth else 180.0 for source in found.sources
        ]
        near = [offset for offset in offsets_deg if abs(offset) < 15]
        hits += bool(near)
        errors_deg += near
        clutter += len(offsets_deg) - len(near)
    assert hits / sum(map(len, truths)) == pytest.approx(0.8, abs=0.04)
    assert clutter / 2000 == pytest.approx(0.1, abs=0.025)
    assert np.std(errors_deg) == pytest.approx(3.0, abs=0.4)

import numpy as np
import pytest

from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.tracking_metrics import TrackingScores, tracking_scores

TOLERANCE = float(np.deg2rad(10))


def score(reference: list[dict[int, float]], estimate: list[dict[int, float]]) -> TrackingScores:
    def radians(windows: list[dict[int, float]]) -> list[dict[int, float]]:
        return [{identity: float(np.deg2rad(azimuth)) for identity, azimuth in one.items()} for one in windows]

    return tracking_scores([(radians(reference), radians(estimate))], TOLERANCE)


def test_perfect_tracks() -> None:
    windows = [{0: 10.0 + t, 1: -170.0 - 3 * t} for t in range(6)]
    scores = score(windows, [{7: one[0], 3: one[1]} for one in windows])
    assert (scores.f_measure, scores.mota, scores.switches, scores.fragments) == (1.0, 1.0, 0, 0)
    assert scores.localization_error == 0.0


def test_swapped_identities_are_two_switches() -> None:
    truth = [{0: 0.0, 1: 90.0}] * 4
    scores = score(truth, [{5: 0.0, 6: 90.0}] * 2 + [{6: 0.0, 5: 90.0}] * 2)
    assert (scores.switches, scores.fragments, scores.f_measure) == (2, 0, 1.0)
    assert scores.mota == pytest.approx(1 - 2 / 8)


def test_new_identity_after_a_pause_is_a_switch_but_no_fragment() -> None:
    truth = [{0: 0.0}, {}, {}, {0: 3.0}]
    scores = score(truth, [{1: 0.0}, {}, {}, {2: 3.0}])
    assert (scores.switches, scores.fragments) == (1, 0)
    assert score(truth, [{1: 0.0}, {}, {}, {1: 3.0}]).switches == 0


def test_miss_in_the_middle_is_a_fragment_and_at_either_end_none() -> None:
    truth = [{0: 0.0}] * 6
    found, lost = {1: 0.0}, dict[int, float]()
    assert score(truth, [found, lost, lost, found, lost, found]).fragments == 2
    assert score(truth, [lost, found, found, found, found, lost]).fragments == 0


def test_pair_of_before_is_kept_while_it_is_within_the_tolerance() -> None:
    truth = [{0: 0.0}] * 3
    # Another identity is nearer for one window; the old one still counts.
    assert score(truth, [{1: 1.0}, {1: 8.0, 2: 0.0}, {1: 1.0}]).switches == 0
    assert score(truth, [{1: 1.0}, {1: 12.0, 2: 0.0}, {1: 1.0}]).switches == 2


def test_identity_that_two_sources_had_goes_to_the_nearer() -> None:
    scores = score([{0: 0.0}, {1: 6.0}, {0: 0.0, 1: 6.0}], [{9: 0.0}, {9: 6.0}, {9: 1.0, 8: 7.0}])
    assert (scores.switches, scores.f_measure) == (1, 1.0)


def test_mistakes_of_every_kind_lower_mota() -> None:
    scores = score([{0: 0.0}, {0: 0.0}, {}], [{1: 50.0}, {1: 0.0}, {1: 0.0}])
    assert scores.mota == pytest.approx(1 - (1 + 2 + 0) / 2)
    assert (scores.precision, scores.recall) == (pytest.approx(1 / 3), pytest.approx(1 / 2))


def test_identities_of_different_recordings_are_strangers() -> None:
    one = ([{0: 0.0}], [{1: 0.0}])
    other = ([{0: 0.0}], [{2: 0.0}])
    assert tracking_scores([one, other], TOLERANCE).switches == 0


def test_unequal_numbers_of_windows_are_refused() -> None:
    with pytest.raises(InputError, match="recording 0 has 2 true and 1 estimated"):
        tracking_scores([([{}, {}], [{}])], TOLERANCE)

import numpy as np
import pytest

from avssl_pyro.benchmarks.recordings import comparison_tables, score_group


def radians(*azimuths_deg: float) -> np.ndarray:
    return np.deg2rad(np.array(azimuths_deg))


def test_counts_found_and_false_directions() -> None:
    labelled = [radians(180, 225), radians(0, 90)]
    # 176 and 233 are 4 and 8 away; 93 is 3 away, a second direction there is one too many, and 0 is missed.
    scores = score_group("m", labelled, [radians(-184, 233), radians(93, 97, -120)])
    assert (scores.close, scores.near, scores.labelled, scores.false) == (2, 3, 4, 2)
    assert np.rad2deg(scores.error) == pytest.approx((4 + 8 + 3) / 3)
    assert (scores.right_counts, scores.recordings) == (1, 2)


def test_a_direction_between_two_talkers_is_one_found_at_most() -> None:
    scores = score_group("m", [radians(10, 20)], [radians(15)])
    assert (scores.near, scores.false) == (1, 0)


def test_one_table_for_every_number_of_talkers() -> None:
    labelled = [radians(0, 90), radians(), radians(180)]
    given = {"good": labelled, "deaf": [radians()] * 3, "parrot": [radians(45)] * 3}
    none, one, two = comparison_tables(labelled, given, ("a note",))
    assert [table.title for table in (none, one, two)] == [
        "0 talkers: 1 recording",
        "1 talker: 1 recording",
        "2 talkers: 1 recording",
    ]
    texts = two.texts()
    assert texts["good"] == ["2 of 2", "2 of 2", "0", "0.0°", "1 of 1"]
    assert texts["deaf"] == ["0 of 2", "0 of 2", "0", "–", "0 of 1"]
    assert texts["parrot"] == ["0 of 2", "0 of 2", "1", "–", "0 of 1"]
    assert (none.notes, one.notes, two.notes) == ((), (), ("a note",))

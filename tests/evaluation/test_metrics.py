import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.matching import angular_errors, assign_then_gate, gate_then_assign
from avssl_pyro.evaluation.metrics import (
    bootstrap_count_accuracy,
    bootstrap_f_measure,
    evaluate,
    summarize,
    tally,
)

azimuth = st.floats(-math.pi, math.pi)
clip = st.lists(azimuth, max_size=5)
clips = st.lists(st.tuples(clip, clip), min_size=1, max_size=6)
tolerance = st.floats(0.01, math.pi)


def degrees(*sets):
    return [np.deg2rad(values) for values in sets]


def test_gating_first_finds_the_pair_that_assigning_first_throws_away():
    truth, guess = degrees([0, 30]), degrees([20, 50])
    tolerance_15 = np.deg2rad(15)
    assert evaluate(truth, guess, tolerance_15, gate_then_assign).f_measure == 0.5
    assert evaluate(truth, guess, tolerance_15, assign_then_gate).f_measure == 0.0


def test_the_seam_is_no_border():
    scores = evaluate(degrees([-179]), degrees([179]), np.deg2rad(5))
    assert scores.f_measure == 1.0
    assert np.rad2deg(scores.localization_error) == pytest.approx(2.0)


def test_a_source_too_many_costs_precision_and_count():
    scores = evaluate(degrees([10]), degrees([10, 100]), np.deg2rad(15))
    assert scores.f_measure == pytest.approx(2 / 3)
    assert (scores.precision, scores.recall, scores.count_accuracy) == (0.5, 1.0, 0.0)
    assert scores.count_confusion.tolist() == [[0, 0, 0], [0, 0, 1], [0, 0, 0]]


@pytest.mark.parametrize("tolerance_deg", [3, 5, 7.5, 10, 15, 20])
@pytest.mark.parametrize("start_deg", [0, 33.3, 175, -170])
@pytest.mark.parametrize("matching", [gate_then_assign, assign_then_gate])
def test_exactly_the_tolerance_is_correct_and_a_thousandth_of_a_degree_more_is_not(tolerance_deg, start_deg, matching):
    gate = np.deg2rad(tolerance_deg)
    truth = degrees([start_deg])
    assert evaluate(truth, degrees([start_deg + tolerance_deg]), gate, matching).f_measure == 1.0
    assert evaluate(truth, degrees([start_deg + tolerance_deg + 1e-3]), gate, matching).f_measure == 0.0


def test_more_pairs_win_over_smaller_errors():
    # Greedy matching would pair 0 with 1 and leave 10 without a partner.
    rows, columns = gate_then_assign(angular_errors(*degrees([0, 10], [1, -9])), np.deg2rad(10))
    assert list(zip(rows, columns, strict=True)) == [(0, 1), (1, 0)]


def test_f_is_pooled_over_clips_not_averaged():
    truth, guess = degrees([0, 90, 180], [0]), degrees([0, 90, 180], [90])
    assert evaluate(truth, guess, np.deg2rad(10)).f_measure == pytest.approx(2 * 3 / 8)


def test_empty_sets_are_defined():
    nothing = np.empty(0)
    silent = evaluate([nothing], [nothing], 0.1)
    assert (silent.precision, silent.recall, silent.f_measure, silent.count_accuracy) == (1.0, 1.0, 1.0, 1.0)
    assert math.isnan(silent.localization_error)
    for truth, guess in (([0.5], nothing), (nothing, [0.5])):
        scores = evaluate([truth], [guess], 0.1)
        assert (scores.precision, scores.recall, scores.f_measure, scores.count_accuracy) == (0.0, 0.0, 0.0, 0.0)


@given(clips, tolerance, st.randoms(use_true_random=False))
def test_the_order_of_azimuths_and_clips_does_not_matter(pairs, gate, random):
    before = evaluate([truth for truth, _ in pairs], [guess for _, guess in pairs], gate)
    shuffled = [(random.sample(truth, len(truth)), random.sample(guess, len(guess))) for truth, guess in pairs]
    random.shuffle(shuffled)
    after = evaluate([truth for truth, _ in shuffled], [guess for _, guess in shuffled], gate)
    assert after.f_measure == before.f_measure
    assert after.localization_error == pytest.approx(before.localization_error, abs=1e-9, nan_ok=True)


whole_degrees = st.lists(st.integers(-180, 179), max_size=5)


@given(st.lists(st.tuples(whole_degrees, whole_degrees), min_size=1, max_size=6), st.integers(-720, 720))
def test_turning_the_world_changes_nothing(pairs, turn_deg):
    # Whole degrees keep errors away from the gate's edge, where rounding would decide.
    def scores(turn):
        truth = [np.deg2rad(np.add(values, turn)) for values, _ in pairs]
        return evaluate(truth, [np.deg2rad(np.add(values, turn)) for _, values in pairs], np.deg2rad(10.5))

    before, after = scores(0), scores(turn_deg)
    assert (after.precision, after.recall, after.f_measure) == (before.precision, before.recall, before.f_measure)
    assert after.localization_error == pytest.approx(before.localization_error, abs=1e-9, nan_ok=True)


@given(clips, tolerance)
def test_scores_stay_in_range_and_gating_first_is_never_worse(pairs, gate):
    truth, guess = [truth for truth, _ in pairs], [guess for _, guess in pairs]
    scores = evaluate(truth, guess, gate)
    for value in (scores.precision, scores.recall, scores.f_measure, scores.count_accuracy):
        assert 0.0 <= value <= 1.0
    assert math.isnan(scores.localization_error) or scores.localization_error <= gate + 1e-6
    assert scores.f_measure >= evaluate(truth, guess, gate, assign_then_gate).f_measure
    assert scores.count_confusion.sum() == len(pairs)
    assert np.trace(scores.count_confusion) == pytest.approx(scores.count_accuracy * len(pairs))


@given(st.lists(clip, min_size=1, max_size=6), tolerance)
def test_the_truth_itself_is_perfect(truth, gate):
    scores = evaluate(truth, [values[::-1] for values in truth], gate)
    assert (scores.precision, scores.recall, scores.f_measure, scores.count_accuracy) == (1.0, 1.0, 1.0, 1.0)


def test_a_mask_selects_clips():
    tallies = tally(degrees([0], [0, 90]), degrees([0], [45]), np.deg2rad(10))
    assert summarize(tallies, np.array([True, False])).f_measure == 1.0
    assert summarize(tallies, np.array([False, True])).f_measure == 0.0
    with pytest.raises(InputError, match="there are no clips"):
        summarize(tallies, np.array([False, False]))


@pytest.mark.parametrize(
    ("truth", "guess", "gate", "message"),
    [
        ([[0.0]], [], 0.1, "1 clips have a reference but 0"),
        ([], [], 0.1, "there are no clips"),
        ([[0.0]], [[0.0]], 0.0, "tolerance of 0.0"),
        ([[0.0]], [[0.0]], math.nan, "tolerance of nan"),
        ([[0.0], [0.0]], [[0.0], [math.nan]], 0.1, "clip 1 .* not a finite number"),
    ],
)
def test_bad_input_is_told(truth, guess, gate, message):
    with pytest.raises(InputError, match=message):
        evaluate(truth, guess, gate)


def test_bootstrap_intervals_cover_a_known_rate():
    # Clips are right with probability 0.8 and independent: about 95 of 100 intervals should contain 0.8.
    rng = np.random.default_rng(1)
    covered = 0
    for trial in range(100):
        right = rng.uniform(size=150) < 0.8
        guesses = [[0.0] if ok else [0.0, 2.0] for ok in right]
        tallies = tally([[0.0]] * 150, guesses, 0.1)
        interval = bootstrap_count_accuracy(tallies, seed=trial, draws=400)
        covered += interval.low <= 0.8 <= interval.high
    assert 85 <= covered <= 100


def test_bootstrap_is_seeded_and_brackets_the_score():
    rng = np.random.default_rng(0)
    truth = [rng.uniform(-3, 3, size=rng.integers(1, 4)) for _ in range(60)]
    guess = [values + rng.normal(0, 0.15, size=values.shape) for values in truth]
    scores = evaluate(truth, guess, 0.17)
    interval = bootstrap_f_measure(scores.tallies, seed=3)
    assert interval == bootstrap_f_measure(scores.tallies, seed=3)
    assert interval != bootstrap_f_measure(scores.tallies, seed=4)
    assert interval.low < scores.f_measure < interval.high

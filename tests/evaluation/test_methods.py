from dataclasses import dataclass

import numpy as np
import pytest

from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.methods import tune


@dataclass(frozen=True)
class Loudest:
    """Observes (azimuth, strength) pairs and keeps those above a threshold."""

    settings: tuple[float, ...]
    name: str = "loudest"

    def observe_all(self, clips):
        return list(clips)

    def decide(self, observation, setting):
        return np.array([azimuth for azimuth, strength in observation if strength >= setting])


def test_the_best_threshold_is_chosen():
    observations = [[(0.0, 0.9), (1.0, 0.2)], [(2.0, 0.8), (0.5, 0.5)]]
    references = [[0.0], [2.0, 0.5]]
    tuned = tune(Loudest((0.1, 0.4, 0.85)), observations, references, 0.1)
    assert (tuned.setting, tuned.f_measure, tuned.count_accuracy) == (0.4, 1.0, 1.0)


def test_no_count_makes_up_for_a_worse_f():
    # At 0.7 two of six talkers are missed, F = 8/10; at 0.3 all are found and an echo in each of two clips, 12/14.
    observations = [[(0.0, 0.9), (2.0, 0.5)]] * 2 + [[(0.0, 0.9), (1.0, 0.9), (2.0, 0.5), (3.0, 0.5)]]
    references = [[0.0], [0.0], [0.0, 1.0, 2.0, 3.0]]
    tuned = tune(Loudest((0.3, 0.7)), observations, references, 0.1)
    assert (tuned.setting, tuned.count_accuracy) == (0.3, pytest.approx(1 / 3))
    assert tuned.f_measure == pytest.approx(12 / 14)


def test_a_hair_of_f_is_given_for_a_better_count():
    # At 0.3 echoes spoil two counts; at 0.7 three talkers of one clip are missed, which is a little worse for F alone.
    crowd = [(0.0, 0.9), (1.0, 0.5), (2.0, 0.5), (3.0, 0.5)]
    observations = [[(0.0, 0.9)]] * 200 + [[(0.0, 0.9), (2.0, 0.5)]] * 2 + [crowd]
    references = [[0.0]] * 202 + [[0.0, 1.0, 2.0, 3.0]]
    tuned = tune(Loudest((0.3, 0.7)), observations, references, 0.1)
    assert tuned.setting == 0.7
    assert tuned.f_measure == pytest.approx(2 * 203 / (203 + 206))


@pytest.mark.parametrize("settings", [(0.7, 0.3), (0.3, 0.7)])
def test_equal_f_is_decided_by_the_count(settings):
    # Both settings score F = 2/3; 0.7 gets one count of two right, 0.3 none.
    observations = [[(0.0, 0.9), (2.0, 0.5)], [(1.0, 0.5), (2.0, 0.5)]]
    tuned = tune(Loudest(settings), observations, [[0.0], [1.0]], 0.1)
    assert (tuned.setting, tuned.count_accuracy) == (0.7, 0.5)
    assert tuned.f_measure == pytest.approx(2 / 3)


def test_a_method_without_settings_is_refused():
    with pytest.raises(InputError, match="'loudest' has no settings"):
        tune(Loudest(()), [[]], [[]], 0.1)

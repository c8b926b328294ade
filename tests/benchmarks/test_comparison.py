from collections import Counter
from dataclasses import dataclass

import numpy as np
import pytest

from avssl_pyro.benchmarks.comparison import run_methods, score_runs
from avssl_pyro.clip import Clip, SceneLabels
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.chance import ConstantCount, RandomAtTrueCount

IMAGE = np.zeros((88, 288, 3), dtype=np.uint8)


def scene(index, num_sources, seed=0):
    """A clip whose audio samples are the azimuths, two for each source: one true, one weak ghost opposite of it."""
    azimuths = np.random.default_rng((seed, index)).uniform(-1.5, 1.5, size=num_sources)
    audio_mn = np.stack([np.concatenate([azimuths, azimuths + np.pi]), np.repeat([1.0, 0.3], num_sources)])
    return Clip(f"{seed}-{index}", audio_mn.astype(np.float32), IMAGE), SceneLabels(tuple(azimuths), (3.0,))


@dataclass(frozen=True)
class Oracle:
    """Reads the azimuths off the audio; its threshold must be tuned to leave out the ghosts."""

    seen: Counter
    name: str = "oracle"
    settings: tuple[float, ...] = (0.0, 0.5, 2.0)

    def observe_all(self, clips):
        observations = []
        for clip in clips:
            self.seen[clip.key] += 1
            observations.append(clip.audio_mn)
        return observations

    def decide(self, observation, setting):
        return observation[0][observation[1] >= setting].astype(np.float64)


def scenes(count, seed):
    return [scene(index, 2 + index % 2, seed) for index in range(count)]


def test_methods_are_tuned_on_validation_and_scored_on_test_scenes():
    rows = score_runs(run_methods([Oracle(Counter())], scenes(6, 0), scenes(81, 1)), "some-silent", 4)
    cell = {(row.method, row.sources, row.tolerance_deg): row for row in rows}
    assert len(rows) == len(cell) == 3 * 3 * 4
    assert {(row.condition, row.microphones) for row in rows} == {("some-silent", 4)}
    assert [cell["oracle", sources, 10.0].clips for sources in (2, 3, "all")] == [41, 40, 81]
    assert cell["oracle", "all", 5.0].f_measure == 1.0
    assert cell["oracle", 3, 10.0].count_accuracy == 1.0
    assert cell["random", "all", 10.0].f_measure < 0.4
    assert cell["random", "all", 10.0].count_accuracy == 1.0
    assert cell["random", 2, 10.0].f_low <= cell["random", 2, 10.0].f_measure <= cell["random", 2, 10.0].f_high
    assert cell["constant-count", 2, 10.0].count_accuracy + cell["constant-count", 3, 10.0].count_accuracy == 1.0


def test_every_clip_is_observed_once_whatever_the_number_of_settings():
    seen = Counter()
    runs = run_methods([Oracle(seen)], iter(scenes(5, 0)), iter(scenes(70, 1)))
    assert len(seen) == 75
    assert set(seen.values()) == {1}
    oracle = runs.methods[-1]
    assert (oracle.name, oracle.tuned.setting, oracle.tuned.f_measure) == ("oracle", 0.5, 1.0)
    assert oracle.ms_per_clip > 0
    assert [len(truth) for truth in runs.references[:4]] == [2, 3, 2, 3]


def test_the_same_seed_gives_the_same_rows():
    def rows(seed):
        runs = run_methods([], scenes(3, 0), scenes(9, 1), chance=[RandomAtTrueCount(seed), ConstantCount(seed)])
        return score_runs(runs, "all-speak", 6, tolerances_deg=(60.0,))

    assert repr(rows(1)) == repr(rows(1))
    assert repr(rows(1)) != repr(rows(2))


def test_constant_count_is_the_most_frequent_of_the_validation_scenes():
    guess = ConstantCount().estimate([np.zeros(3), np.zeros(3), np.zeros(2)], [np.zeros(2), np.zeros(1)])
    assert [len(azimuths) for azimuths in guess] == [3, 3]


@pytest.mark.parametrize("empty", ["validation", "test"])
def test_an_empty_set_is_named(empty):
    sets = {"validation": scenes(2, 0), "test": scenes(2, 1), empty: []}
    with pytest.raises(InputError, match=f"{empty} scenes: there are none"):
        run_methods([], sets["validation"], sets["test"])

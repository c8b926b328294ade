import json
from dataclasses import dataclass

import numpy as np
import pytest

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.benchmarks.cache import CONVERTER
from avssl_pyro.benchmarks.condition import (
    ConditionResult,
    coverage_table,
    judge_posteriors,
    run_condition,
    talking_table,
    timing_table,
)
from avssl_pyro.benchmarks.paper.experiment import score_cells
from avssl_pyro.clip import Clip, SceneLabels
from avssl_pyro.evaluation.methods import PosteriorMethod
from avssl_pyro.evaluation.peaks import PeakSetting
from avssl_pyro.localization.posterior import ClipPosterior

GRID = DirectionGrid()
IMAGE = np.zeros((88, 288, 3), dtype=np.uint8)
STD = np.deg2rad(2.0)


def scene(index):
    """Two or three talkers and one silent person, far apart, told in the audio; the silent one last."""
    directions = (np.array([5, 25, 45, 60])[: 3 + index % 2] + index) % 72
    azimuths = GRID.azimuths[directions]
    audio_mn = np.zeros((4, 8), dtype=np.float32)
    audio_mn[0, : len(directions)] = directions
    audio_mn[1, 0] = len(directions)
    return Clip(str(index), audio_mn, IMAGE), SceneLabels(tuple(azimuths[:-1]), (float(azimuths[-1]),))


def posterior(clip, silent_level):
    """A class per person, loud for talkers; errors of 3 and of 1 degrees take turns, the stated spread is 2."""
    directions = clip.audio_mn[0, : int(clip.audio_mn[1, 0])].astype(int)
    k = len(directions)
    offset = np.deg2rad(1.0 if int(clip.key) % 2 else 3.0)
    away_kd = (GRID.azimuths - GRID.azimuths[directions][:, None] - offset + np.pi) % (2 * np.pi) - np.pi
    weights_kd = np.exp(-0.5 * (away_kd / np.deg2rad(4.0)) ** 2) + 1e-12
    weights_kd /= weights_kd.sum(-1, keepdims=True)
    level_k = np.array([0.3] * (k - 1) + [silent_level])
    return ClipPosterior(weights_kd, level_k, np.full(k, 0.01), np.full(k, STD))


@dataclass(frozen=True)
class Deaf:
    """A baseline that finds nothing."""

    name: str = "music"
    settings: tuple[PeakSetting, ...] = (PeakSetting(0.5, 2),)

    def observe_all(self, clips):
        return [None for _ in clips]

    def decide(self, _observation, _setting):
        return np.empty(0)


def methods(silent_level=0.01):
    def posteriors(clips):
        return [posterior(clip, silent_level) for clip in clips]

    return [Deaf(), PosteriorMethod("amortized", posteriors, GRID), PosteriorMethod("no-audio-net", posteriors, GRID)]


def cell(silent_level=0.01, num=12):
    scenes = [scene(index) for index in range(num)]
    return run_condition("some-silent", PRESETS["circle4"], methods(silent_level), scenes, scenes)


def test_posteriors_are_judged_on_all_people_and_matched_sources():
    found = cell()
    (stored,) = found.posteriors
    assert stored.method == "amortized"
    assert stored.talking == pytest.approx((0.3,) * 30, rel=0.02)
    assert stored.silent == pytest.approx((0.01,) * 12, rel=0.02)
    # Of 30 talkers, 12 are in even scenes with two each and an error of 3 degrees.
    (judged,) = judge_posteriors([found])
    calibration = judged.calibration
    assert calibration.sources == 30
    assert calibration.within_one == pytest.approx(18 / 30)
    assert calibration.within_two == 1.0
    assert calibration.scale == pytest.approx(1.5, abs=1e-6)
    assert judged.curve.area == 1.0
    assert talking_table([judged]).texts() == {"amortized": ["1.000"]}
    assert "30 talking, 12 silent people" in talking_table([judged]).notes[1]


def test_a_level_that_knows_nothing_has_an_area_of_one_half():
    found = cell(silent_level=0.3)
    assert judge_posteriors([found])[0].curve.area == pytest.approx(0.5, abs=0.1)


def test_a_cell_survives_json():
    found = cell()
    data = CONVERTER.unstructure(found)
    again = CONVERTER.structure(json.loads(json.dumps(data, allow_nan=False)), ConditionResult)
    assert CONVERTER.unstructure(again) == data
    assert (again.condition, again.array, again.microphones) == ("some-silent", "circle4", 4)
    names = ["random", "constant-count", "music", "amortized", "no-audio-net"]
    assert [run.name for run in again.runs.methods] == names
    assert again.runs.methods[3].tuned.setting["least"] == 0.01
    for before, after in zip(found.runs.methods, again.runs.methods, strict=True):
        for first, second in zip(before.estimates, after.estimates, strict=True):
            assert np.array_equal(second, first)
    assert again.posteriors[0].test.stds_p == pytest.approx(found.posteriors[0].test.stds_p)


def test_the_report_shows_times_and_coverage_and_names_what_is_behind():
    report = score_cells([cell()], {"cells": []})
    headline = {row.method: row for row in report.rows if (row.sources, row.tolerance_deg) == ("all", 10.0)}
    assert [headline[method].f_measure for method in ("music", "amortized", "no-audio-net")] == [0.0, 1.0, 1.0]
    assert headline["random"].count_low == headline["random"].count_high == 1.0
    assert list(timing_table(report.cells).texts()) == ["music", "no-audio-net", "amortized"]
    assert coverage_table(judge_posteriors(report.cells)).texts()["some-silent M=4 amortized"][0] == "30"
    assert report.behind() == []

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.benchmarks.separation import UNPROCESSED, Improvements, SeparationExperiment, lead, separation_table
from avssl_pyro.benchmarks.separation_methods import (
    DelayAndSumAtTruth,
    Estimates,
    OracleMasks,
    PosteriorSeparation,
    TalkerMixture,
    draw_mixture,
)
from avssl_pyro.clip import Clip
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.localization.posterior import ClipPosterior
from avssl_pyro.separation.beamforming import Masking, WienerFilter
from avssl_pyro.separation.separator import Separator
from avssl_pyro.simulation.scene_config import Condition, SceneConfig
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.systems.config import GuideConfig
from avssl_pyro.systems.system import SystemConfig, build_system

ARRAY = PRESETS["circle4"]
SIMULATOR = SceneSimulator(SceneConfig(condition=Condition("two", people=(2, 3), talkers=(2,))), seed=3, array=ARRAY)
SYSTEM = SystemConfig(ARRAY, guide=GuideConfig(visual_channels=(4, 8), audio_channels=8))


@pytest.fixture(scope="module")
def mixture() -> TalkerMixture:
    return draw_mixture(SIMULATOR, 0)


class Told(Localizer):
    """Is told where to look."""

    def __init__(self, azimuths: Sequence[float]) -> None:
        torch.manual_seed(0)
        super().__init__(build_system(SYSTEM))
        self.azimuths = azimuths

    def posteriors(self, clips: Sequence[Clip]) -> list[ClipPosterior]:
        offset_kd = np.remainder(self.config.grid.azimuths - np.array(self.azimuths)[:, None] + np.pi, 2 * np.pi)
        weights_kd = np.exp(-0.5 * ((offset_kd - np.pi) / np.deg2rad(4)) ** 2)
        weights_kd = np.concatenate([weights_kd, np.ones((1, 72))])
        k = len(weights_kd)
        weights_kd /= weights_kd.sum(-1, keepdims=True)
        return [ClipPosterior(weights_kd, np.full(k, 1 / k), np.full(k, 0.01), np.full(k, 0.03)) for _ in clips]


def separation(azimuths: Sequence[float]) -> PosteriorSeparation:
    return PosteriorSeparation(Told(azimuths), {"told": Separator(SYSTEM)})


def test_the_parts_of_a_mixture_are_its_talkers_and_noise(mixture: TalkerMixture) -> None:
    parts_smn = mixture.images_and_noise()
    assert parts_smn.shape == (3, 4, 16_000)
    np.testing.assert_allclose(parts_smn.sum(0), mixture.clip.audio_mn, atol=1e-6)
    talkers_mn, noise_mn = parts_smn[:2].sum(0), parts_smn[2]
    # 20 dB below the talkers, as the scenes have it, and telling nothing of them.
    assert 10 * np.log10(np.mean(talkers_mn**2) / np.mean(noise_mn**2)) == pytest.approx(20, abs=0.2)
    assert np.linalg.norm(mixture.unit_vectors_sx, axis=1) == pytest.approx([1, 1])
    azimuths = np.arctan2(mixture.unit_vectors_sx[:, 1], mixture.unit_vectors_sx[:, 0])
    assert azimuths == pytest.approx(mixture.azimuths)


def test_who_knows_the_masks_separates_better_than_who_knows_the_directions(mixture: TalkerMixture) -> None:
    oracle = OracleMasks({"wiener": WienerFilter(), "masks": Masking()})
    experiment = SeparationExperiment(SIMULATOR, [DelayAndSumAtTruth(ARRAY), oracle, separation(mixture.azimuths)])
    rows = experiment.run(0)
    assert list(rows) == [UNPROCESSED, "delay and sum", "wiener", "masks", "told"]
    means = {name: float(row.image_s.mean()) for name, row in rows.items()}
    assert means["delay and sum"] + 6 < min(means["wiener"], means["masks"])
    assert means["delay and sum"] + 3 < means["told"] < means["masks"]
    # Summing microphones takes away what comes from elsewhere: reflections too.
    assert rows["delay and sum"].direct_s.mean() > means["delay and sum"]


def test_sources_go_to_talkers_by_direction_and_a_missed_one_counts_as_unprocessed(mixture: TalkerMixture) -> None:
    first, second = mixture.azimuths
    (both,) = separation((second, first))(mixture).values()
    (other_order,) = separation((first, second))(mixture).values()
    for one, other in zip(both, other_order, strict=True):
        assert one is not None
        assert other is not None
        np.testing.assert_allclose(one, other, atol=1e-5)
    lost = [separation((second, first + np.deg2rad(14)))]
    row = SeparationExperiment(SIMULATOR, lost).run(0)["told"]
    assert row.missed == 1
    assert (row.image_s[0], row.direct_s[0]) == (0, 0)
    assert row.image_s[1] > 0


def test_estimates_that_are_the_truth_gain_what_the_mixture_lacks(mixture: TalkerMixture) -> None:
    @dataclass(frozen=True)
    class Cheat:
        def __call__(self, mixture: TalkerMixture) -> dict[str, Estimates]:
            return {"cheat": list(0.1 * mixture.images_smn[:, 0])}

    rows = SeparationExperiment(SIMULATOR, [Cheat()]).run(0)
    np.testing.assert_allclose(rows["cheat"].image_s, 100 - rows[UNPROCESSED].image_s, atol=1.0)


def improvements(*image: float, missed: int = 0) -> Improvements:
    return Improvements(np.array(image), np.array(image) - 1, missed)


def test_the_table_has_means_intervals_and_the_lead() -> None:
    trials = [
        {UNPROCESSED: improvements(0.0, -2.0), "a": improvements(1.0 + b, 2.0), "b": improvements(5.0 + b, 8.0)}
        for b in range(4)
    ]
    trials[0]["b"] = replace(trials[0]["b"], missed=1)
    table = separation_table(trials, "title", "b", "a")
    (first, cells), (second, others) = table.texts().items()
    assert (first, second) == ("a", "b")
    assert [cells[column] for column in (0, 2, 3, 5)] == ["2.25", "2.00", "1.25", "0.0%"]
    assert others[-1] == "12.5%"
    low, high = (float(word) for word in cells[1].split(" to "))
    assert 1.5 <= low < 2.25 < high <= 3.0
    for mean, interval in lead(trials, "b", "a"):
        assert mean == interval.low == interval.high == 5.0
    assert "b above a: 5.0 dB (5.0 to 5.0) against the image, 5.0 dB (5.0 to 5.0) against direct sound." in table.notes
    assert "-1.0 dB against the image, -2.0 dB against direct sound" in table.notes[0]

"""Methods of a comparison, and the settings that determine their estimates."""

from dataclasses import replace

import pytest
import torch
from attrs import evolve

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.benchmarks import comparison
from avssl_pyro.benchmarks.comparison import MethodSuite, system_band_hz
from avssl_pyro.benchmarks.result_tables import method_order
from avssl_pyro.evaluation.baselines import BASELINES, Music
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.systems.config import GuideConfig
from avssl_pyro.systems.system import System, SystemConfig, build_system


def small_system(audio_net: bool = True) -> System:
    torch.manual_seed(0)
    guide = GuideConfig(audio_net=audio_net, visual_channels=(4, 4), audio_channels=4)
    return build_system(SystemConfig(PRESETS["circle4"], guide=guide, stft=StftConfig(low_hz=200.0, high_hz=4000.0)))


@pytest.fixture(scope="module")
def suite() -> MethodSuite:
    system = small_system()
    return MethodSuite(system, system, RefinementConfig(rounds=3))


def test_every_row_of_the_tables_but_chance(suite: MethodSuite) -> None:
    assert [method.name for method in suite.methods()] == list(method_order()[2:])


def test_without_an_audio_network_all_rows_are_there() -> None:
    """Refinement starts from the picture and from equal levels, so it does not miss the network."""
    system = small_system(audio_net=False)
    names = [method.name for method in MethodSuite(system, system, RefinementConfig()).methods()]
    assert names == list(method_order()[2:])


def test_the_baselines_search_the_band_they_are_told(suite: MethodSuite) -> None:
    band = system_band_hz(suite.system)
    # Bins of 31.25 Hz: 7 to 128, and the end that pyroomacoustics leaves out.
    assert band == (218.75, 4031.25)
    for given, expected in ((suite, (500.0, 4000.0)), (replace(suite, baseline_band_hz=band), band)):
        assert [method.freq_range_hz for method in given.methods()[:3]] == [expected] * 3  # type: ignore[attr-defined]


def test_settings_tell_apart_whatever_changes_the_numbers(suite: MethodSuite, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = suite.settings()
    assert replace(suite, workers=2).settings() == settings
    monkeypatch.setattr(comparison, "BASELINES", [*BASELINES, Music])
    assert suite.settings() != settings
    monkeypatch.undo()
    for other in (
        replace(suite, refinement=evolve(suite.refinement, rounds=4)),
        replace(suite, baseline_band_hz=(200.0, 4000.0)),
        replace(suite, without_audio=small_system(audio_net=False)),
    ):
        assert other.settings() != settings

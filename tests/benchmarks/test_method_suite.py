"""Who stands in the comparison, and on what ground."""

from dataclasses import replace

import pytest
import torch

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.benchmarks.method_suite import MethodSuite, system_band_hz
from avssl_pyro.evaluation.tables import METHOD_ORDER
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.systems.config import GuideConfig
from avssl_pyro.systems.system import System, SystemConfig, build_system


def small_system(audio_net: bool = True) -> System:
    torch.manual_seed(0)
    guide = GuideConfig(audio_net=audio_net, visual_channels=(4, 4), audio_channels=4)
    return build_system(SystemConfig(PRESETS["circle4"], guide=guide, stft=StftConfig(low_hz=200.0, high_hz=4000.0)))


@pytest.fixture(scope="module")
def line_up() -> MethodSuite:
    system = small_system()
    return MethodSuite(system, system, RefinementConfig(rounds=3))


def test_every_row_of_the_tables_but_the_trivial_ones(line_up: MethodSuite) -> None:
    assert [method.name for method in line_up.methods()] == list(METHOD_ORDER[2:])


def test_without_an_audio_network_all_rows_are_there() -> None:
    """Refinement starts from the picture and from equal levels, so it does not miss the network."""
    system = small_system(audio_net=False)
    names = [method.name for method in MethodSuite(system, system, RefinementConfig()).methods()]
    assert names == list(METHOD_ORDER[2:])


def test_the_baselines_search_the_band_they_are_told(line_up: MethodSuite) -> None:
    band = system_band_hz(line_up.system)
    # Bins of 31.25 Hz: 7 to 128, and the end that pyroomacoustics leaves out.
    assert band == (218.75, 4031.25)
    for given, expected in ((line_up, (500.0, 4000.0)), (replace(line_up, baseline_band_hz=band), band)):
        assert [method.freq_range_hz for method in given.methods()[:3]] == [expected] * 3  # type: ignore[attr-defined]


def test_facts_tell_apart_whatever_changes_the_numbers(line_up: MethodSuite) -> None:
    facts = line_up.facts()
    assert replace(line_up, workers=2).facts() == facts
    for other in (
        replace(line_up, refinement=replace(line_up.refinement, rounds=4)),
        replace(line_up, baseline_band_hz=(200.0, 4000.0)),
        replace(line_up, without_audio=small_system(audio_net=False)),
    ):
        assert other.facts() != facts

"""The shipped weights: there, sound, found by geometry, and fitted to arrays that have none."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.compatibility import is_same_array
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering_kinds import RigidSphereKind
from avssl_pyro.distributions.spatial_mixture import LEAST_DIFFUSE
from avssl_pyro.evaluation.matching import gate_then_assign
from avssl_pyro.evaluation.metrics import evaluate
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.direct_level import DirectLevelRule
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.systems import config
from avssl_pyro.systems.config import PRETRAINED
from avssl_pyro.systems.pretrained import load_pretrained


@pytest.mark.parametrize("name", PRETRAINED)
def test_shipped_weights_belong_to_their_array(name: str) -> None:
    pretrained = load_pretrained(PRESETS[name])
    assert pretrained.native
    assert pretrained.trained_with == name
    assert name in pretrained.sentence
    assert pretrained.system.config.array.num_microphones == PRESETS[name].num_microphones
    assert is_same_array(pretrained.system.config.array, PRESETS[name])


def test_an_array_is_known_by_its_places_not_its_name() -> None:
    same = replace(PRESETS["circle4"], name="mine")
    assert load_pretrained(same).trained_with == "circle4"
    turned = MicrophoneArray("circle4", PRESETS["circle4"].positions_m[::-1])
    assert not load_pretrained(turned).native
    for other in ({"steering": RigidSphereKind(0.1)}, {"speed_of_sound": 1500.0}):
        assert not load_pretrained(replace(PRESETS["circle4"], **other)).native  # type: ignore[arg-type]


def test_an_array_without_places_is_served_too() -> None:
    pretrained = load_pretrained(PRESETS["starss23-foa"])
    assert not pretrained.native
    assert pretrained.system.config.steering().shape[-1] == 4


def test_another_array_is_told_what_it_gets() -> None:
    pretrained = load_pretrained(PRESETS["circle5"])
    assert not pretrained.native
    assert "circle5" in pretrained.sentence
    assert "circle6" in pretrained.sentence
    assert pretrained.system.config.array == PRESETS["circle5"]


@pytest.mark.parametrize(("name", "least"), [("circle6", 0.8), ("circle5", 0.7)])
def test_they_find_who_talks_in_scenes_of_material_they_never_saw(name: str, least: float) -> None:
    """Figures and voices made in code, not the photographs and recordings they were trained on."""
    array = PRESETS[name]
    simulator = SceneSimulator(seed=7, array=array)
    scenes = [simulator.render(index) for index in range(12)]
    system = load_pretrained(array).system
    posteriors = Localizer(system, refinement=RefinementConfig()).posteriors([scene.clip for scene in scenes])
    found = [
        np.array([source.azimuth for source in DirectLevelRule().select(posterior, system.config.grid)])
        for posterior in posteriors
    ]
    scores = evaluate([scene.labels.talker_azimuths for scene in scenes], found, np.deg2rad(10.0), gate_then_assign)
    assert scores.f_measure > least


def test_the_least_diffuse_share_is_that_of_the_distribution() -> None:
    assert LEAST_DIFFUSE[torch.complex64] == config.LEAST_DIFFUSE

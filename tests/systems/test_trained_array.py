from dataclasses import replace

import numpy as np
import pytest

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.errors import InputError
from avssl_pyro.systems.config import GuideConfig
from avssl_pyro.systems.system import System, SystemConfig, build_system
from avssl_pyro.systems.trained_array import check_array

ARRAY = PRESETS["circle4"]


@pytest.fixture(scope="module")
def system() -> System:
    return build_system(SystemConfig(ARRAY, guide=GuideConfig(visual_channels=(4, 8), audio_channels=8)))


def moved(distance_m: float) -> np.ndarray:
    positions_m = np.array(ARRAY.positions_m)
    positions_m[2, 1] += distance_m
    return positions_m


def test_names_channels_and_what_a_ruler_cannot_tell_do_not_matter(system: System) -> None:
    placed = tuple(tuple(row) for row in moved(0.0005).tolist())
    check_array(system, replace(ARRAY, name="mine", positions_m=placed, channels=(5, 3, 2, 1)), "some.safetensors")


def test_a_moved_microphone_is_named(system: System) -> None:
    placed = tuple(tuple(row) for row in moved(0.02).tolist())
    with pytest.raises(InputError, match=r"some\.safetensors: .* microphone 3 is 2\.0 cm from that of 'mine'"):
        check_array(system, replace(ARRAY, name="mine", positions_m=placed), "some.safetensors")

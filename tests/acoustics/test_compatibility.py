from dataclasses import replace

import numpy as np
import pytest

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.compatibility import check_trained_array, matching_channels
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.errors import InputError

ARRAY = PRESETS["circle4"]


def moved(distance_m: float) -> np.ndarray:
    positions_m = np.array(ARRAY.positions_m)
    positions_m[2, 1] += distance_m
    return positions_m


def test_names_channels_and_what_a_ruler_cannot_tell_do_not_matter() -> None:
    placed = tuple(tuple(row) for row in moved(0.0005).tolist())
    check_trained_array(
        ARRAY, replace(ARRAY, name="mine", positions_m=placed, channels=(5, 3, 2, 1)), "some.safetensors"
    )


def test_a_moved_microphone_is_named() -> None:
    placed = tuple(tuple(row) for row in moved(0.02).tolist())
    with pytest.raises(InputError, match=r"some\.safetensors: .* microphone 3 is 2\.0 cm from that of 'mine'"):
        check_trained_array(ARRAY, replace(ARRAY, name="mine", positions_m=placed), "some.safetensors")


def test_recordings_go_with_their_own_kind_of_steering_only() -> None:
    tetrahedron, foa = PRESETS["starss23-mic"], PRESETS["starss23-foa"]
    in_free_field = MicrophoneArray("open", tetrahedron.positions_m)
    with pytest.raises(InputError, match=r"'open' in free field, but array 'starss23-mic' is on a rigid sphere"):
        matching_channels(in_free_field, tetrahedron, "scenes")
    with pytest.raises(InputError, match=r"'circle4' in free field, but array 'starss23-foa' is in first-order"):
        matching_channels(PRESETS["circle4"], foa, "scenes")
    assert matching_channels(foa, foa, "scenes") == (0, 1, 2, 3)
    assert matching_channels(PRESETS["eigenmike32"], tetrahedron, "scenes") == (5, 9, 25, 21)

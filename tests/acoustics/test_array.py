import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.errors import InputError

LINE = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]

coordinates = st.floats(-2.0, 2.0)
positions = st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=2, max_size=6).filter(
    lambda rows: all(1e-3 < math.dist(first, second) < 4.9 for i, first in enumerate(rows) for second in rows[i + 1 :])
)
arrays = st.builds(MicrophoneArray, st.text(max_size=20), positions.map(tuple), st.floats(100.0, 2000.0))

scalars = st.one_of(
    st.none(), st.booleans(), st.integers(), st.integers(10**300, 10**400), st.floats(), st.text(max_size=5)
)
rows = st.lists(scalars, max_size=4) | st.lists(st.floats(), min_size=3, max_size=3)
garbage = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(scalars, inner, max_size=3), max_leaves=5
)
almost_arrays = st.fixed_dictionaries(
    {}, optional={"positions_m": st.lists(rows, max_size=4) | garbage, "speed_of_sound": scalars, "name": garbage}
)


def changed(microphone: int, position: list[float]) -> dict[str, Any]:
    """A line of three microphones with one of them (from 1) elsewhere."""
    positions_m = [list(row) for row in LINE]
    positions_m[microphone - 1] = position
    return {"name": "line", "positions_m": positions_m}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (changed(2, [0.1, math.nan, 0.0]), ["'line'", "microphone 2", "finite"]),
        (changed(3, [math.inf, 0.0, 0.0]), ["microphone 3", "finite"]),
        (changed(3, [0.2, 0.0]), ["microphone 3", "2 coordinates", "x, y, z"]),
        (changed(3, [0.1, 0.0, 0.0]), ["microphones 2 and 3", "own place"]),
        (changed(3, [200.0, 0.0, 0.0]), ["microphones 1 and 3", "200 m apart", "millimetres"]),
        (changed(3, [1e308, 0.0, 0.0]), ["microphones 1 and 3", "millimetres"]),
        ({"positions_m": LINE[:1]}, ["1 microphone", "at least two"]),
        ({"positions_m": []}, ["0 microphone", "at least two"]),
        ({"positions_m": LINE, "speed_of_sound": 34.3}, ["34.3", "343"]),
        ({"positions_m": LINE, "speed_of_sound": math.nan}, ["nan", "343"]),
        ({"positions_m": LINE, "position": 1}, ["unknown key 'position'", "positions_m"]),
        ({"name": "line"}, ["'positions_m' is missing"]),
        ({"positions_m": [1.0, 2.0]}, ["list of [x, y, z] rows"]),
        ({"positions_m": [["a", 0, 0], [0, 0, 0]]}, ["must be numbers"]),
        ({"positions_m": [[10**400, 0, 0], [0, 0, 0]]}, ["must be numbers"]),
        ([1, 2], ["found list"]),
        (None, ["found NoneType"]),
    ],
)
def test_wrong_geometry_is_refused_in_one_sentence_that_names_the_microphone(data: Any, words: list[str]) -> None:
    with pytest.raises(InputError) as refused:
        MicrophoneArray.from_dict(data)
    message = str(refused.value)
    assert all(word in message for word in words), message
    assert "\n" not in message


@given(st.one_of(almost_arrays, garbage))
def test_any_mapping_makes_a_valid_array_or_an_input_error(data: Any) -> None:
    try:
        array = MicrophoneArray.from_dict(data)
    except InputError as error:
        assert str(error)
        return
    assert array.num_microphones >= 2
    assert np.isfinite(array.positions).all()
    assert array.positions.shape == (array.num_microphones, 3)


@given(arrays)
def test_yaml_gives_back_the_array(tmp_path_factory: pytest.TempPathFactory, array: MicrophoneArray) -> None:
    path = tmp_path_factory.getbasetemp() / "array.yaml"
    array.save(path)
    assert MicrophoneArray.load(path) == array


@pytest.mark.parametrize(
    "content",
    [
        b"positions_m: [[0, 0, 0], [0.1",
        b"\xff\xfe\x00binary",
        b"positions_m: [[0, 0, 2020-13-45], [0, 0, 0]]",
        b"",
        b"just text",
        b"[" * 3000,
    ],
)
def test_broken_files_are_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "mine.yaml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"mine\.yaml") as refused:
        MicrophoneArray.load(path)
    assert "\n" not in str(refused.value)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.yaml"):
        MicrophoneArray.load(tmp_path / "absent.yaml")


def test_file_with_wrong_geometry_is_named_as_well_as_the_microphone(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("positions_m: [[0, 0, 0], [0.1, 0, .nan]]")
    with pytest.raises(InputError, match=r"mine\.yaml.*microphone 2"):
        MicrophoneArray.load(path)


def test_select_keeps_the_given_order() -> None:
    array = PRESETS["circle6"]
    part = array.select((4, 1))
    assert part.positions_m == (array.positions_m[4], array.positions_m[1])
    assert part.speed_of_sound == array.speed_of_sound

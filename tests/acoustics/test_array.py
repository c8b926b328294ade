import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering_kinds import AmbisonicsKind, MeasuredKind, RigidSphereKind
from avssl_pyro.errors import InputError

LINE = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]

coordinates = st.floats(-2.0, 2.0)
positions = st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=2, max_size=6).filter(
    lambda rows: all(1e-3 < math.dist(first, second) < 4.9 for i, first in enumerate(rows) for second in rows[i + 1 :])
)
arrays = st.builds(MicrophoneArray, st.text(max_size=20), positions.map(tuple), st.floats(100.0, 2000.0))

kinds = st.sampled_from(["free-field", "rigid-sphere", "first-order-ambisonics", "measured"])

scalars = st.one_of(
    st.none(), st.booleans(), st.integers(), st.integers(10**300, 10**400), st.floats(), st.text(max_size=5)
)
rows = st.lists(scalars, max_size=4) | st.lists(st.floats(), min_size=3, max_size=3)
garbage = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(scalars, inner, max_size=3), max_leaves=5
)
almost_steering = st.fixed_dictionaries(
    {},
    optional={
        "kind": kinds | garbage,
        "radius_m": scalars,
        "centre_m": rows,
        "order": scalars,
        "file": st.none() | st.just("nowhere.sofa"),
    },
)
almost_arrays = st.fixed_dictionaries(
    {},
    optional={
        "positions_m": st.lists(rows, max_size=4) | garbage,
        "speed_of_sound": scalars,
        "name": garbage,
        "channels": rows | garbage,
        "steering": almost_steering | garbage,
    },
)


def changed(microphone: int, position: list[float]) -> dict[str, Any]:
    """A line of three microphones with one of them (from 1) elsewhere."""
    positions_m = [list(row) for row in LINE]
    positions_m[microphone - 1] = position
    return {"name": "line", "positions_m": positions_m}


def steered(kind: str, **options: Any) -> dict[str, Any]:
    return {"positions_m": LINE, "steering": {"kind": kind, **options}}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (changed(2, [0.1, math.nan, 0.0]), ["'line'", "microphone 2", "finite"]),
        (changed(3, [math.inf, 0.0, 0.0]), ["microphone 3", "finite"]),
        (changed(3, [0.2, 0.0]), ["microphone 3", "2 coordinates", "x, y, z"]),
        (changed(3, [0.1, 0.0, 0.0]), ["microphones 2 and 3", "different positions"]),
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
        ({"positions_m": LINE, "channels": [1, 2]}, ["'channels' has 2 entries for 3 microphones"]),
        ({"positions_m": LINE, "channels": [1, 0, 2]}, ["microphone 2 is on channel 0", "count from 1"]),
        ({"positions_m": LINE, "channels": [4, 5, 4]}, ["microphones 1 and 3", "both on channel 4"]),
        ({"positions_m": LINE, "channels": [1, 2.5, 3]}, ["'channels' must be a list of whole numbers"]),
        ({"positions_m": LINE, "channels": [1, True, 3]}, ["'channels' must be a list of whole numbers"]),
        ({"positions_m": LINE, "channels": "123"}, ["'channels' must be a list of whole numbers"]),
        (steered("rigid-sphere"), ["'radius_m' is missing", "metres"]),
        (steered("rigid-sphere", radius_m=42), ["radius_m is 42", "give metres"]),
        (steered("rigid-sphere", radius_m=math.nan), ["radius_m is nan"]),
        (steered("rigid-sphere", radius_m="big"), ["must be numbers"]),
        (steered("rigid-sphere", radius_m=0.1, centre_m=[0, 0]), ["'centre_m' must be [x, y, z]"]),
        (steered("rigid-sphere", radius_m=0.1, center_m=[0, 0, 0]), ["unknown key 'center_m'", "centre_m"]),
        (steered("rigid-sphere", radius_m=0.1), ["microphone 1 is 0 cm from the centre", "radius is 10 cm"]),
        (steered("free-field", radius_m=0.1), ["unknown key 'radius_m'", "free-field has no keys"]),
        (steered("first-order-ambisonics"), ["has positions", "leave 'positions_m' out"]),
        ({"steering": {"kind": "first-order-ambisonics", "order": "sid"}}, ["order is 'sid'", "acn, fuma"]),
        ({"steering": {"kind": "first-order-ambisonics", "normalization": "n2d"}}, ["'n2d'", "sn3d, n3d, maxn"]),
        (steered("measured"), ["'file' is missing", "SOFA"]),
        (steered("measured", file="absent.sofa"), ["absent.sofa: no such SOFA file"]),
        (steered("sphere"), ["kind of free-field, rigid-sphere, first-order-ambisonics, measured", "'sphere'"]),
        ({"positions_m": LINE, "steering": "rigid-sphere"}, ["must be a mapping", "found 'rigid-sphere'"]),
        ({"positions_m": LINE, "steering": {"kind": ["measured"]}}, ["must be a mapping with a kind"]),
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
    assert array.positions.shape == (0 if isinstance(array.steering, AmbisonicsKind) else array.num_microphones, 3)
    assert len(array.channel_indices) == array.num_microphones


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


def test_a_file_names_its_channels_and_its_sphere(tmp_path: Path) -> None:
    path = tmp_path / "ball.yaml"
    path.write_text(
        "positions_m: [[0.052, 0, 0], [0.01, 0.042, 0]]\n"
        "channels: [5, 2]\n"
        "steering: {kind: rigid-sphere, radius_m: 0.042, centre_m: [0.01, 0, 0]}\n"
    )
    array = MicrophoneArray.load(path)
    assert array.name == "ball"
    assert array.channel_indices == (4, 1)
    assert array.steering == RigidSphereKind(0.042, (0.01, 0.0, 0.0))
    assert MicrophoneArray.from_dict(array.to_dict()) == array
    assert array.select((1, 0)).channels == (2, 5)


def test_ambisonics_needs_no_positions(tmp_path: Path) -> None:
    path = tmp_path / "foa.yaml"
    path.write_text("steering: {kind: first-order-ambisonics, order: fuma, normalization: maxn}\n")
    array = MicrophoneArray.load(path)
    assert array.num_microphones == 4
    assert array.steering == AmbisonicsKind("fuma", "maxn")
    array.save(path)
    assert MicrophoneArray.load(path) == array
    with pytest.raises(InputError, match=r"'foa' is in first-order ambisonics.*no sub-arrays"):
        array.select((0, 1))


def test_free_field_looks_in_a_file_as_it_always_did() -> None:
    assert set(PRESETS["circle4"].to_dict()) == {"name", "speed_of_sound", "positions_m"}


def test_measured_responses_are_found_beside_the_file_and_known_by_their_bytes(
    write_sofa: Callable[..., Path], tmp_path: Path
) -> None:
    sofa = write_sofa(PRESETS["circle4"], np.arange(0.0, 360.0, 10.0))
    path = sofa.parent / "mine.yaml"
    path.write_text("steering: {kind: measured, file: measured.sofa}\nspeed_of_sound: 340\n")
    array = MicrophoneArray.load(path)
    assert array.num_microphones == 4
    assert array.steering_vectors(DirectionGrid(36), np.array([1000.0])).shape == (1, 36, 4)
    # Written elsewhere, it still finds the file; what was copied elsewhere is the same.
    moved = tmp_path / "elsewhere.yaml"
    array.save(moved)
    assert MicrophoneArray.load(moved) == array
    copy = tmp_path / "copy.sofa"
    copy.write_bytes(sofa.read_bytes())
    assert MeasuredKind.read(copy) == array.steering

    sofa.write_bytes(write_sofa(PRESETS["circle4"], np.arange(0.0, 360.0, 5.0)).read_bytes())
    with pytest.raises(InputError, match=r"measured\.sofa: not the file used before.*restore that file"):
        MicrophoneArray.load(moved).steering_vectors(DirectionGrid(36), np.array([1000.0]))


def test_positions_beside_measured_responses_must_be_as_many(write_sofa: Callable[..., Path]) -> None:
    sofa = write_sofa(PRESETS["circle4"], np.arange(0.0, 360.0, 10.0))
    with pytest.raises(InputError, match=r"has 3 positions, but measured\.sofa has responses of 4 microphones"):
        MicrophoneArray.from_dict(steered("measured", file=str(sofa)))


def test_the_file_in_the_documentation_is_an_array(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "arrays.md").read_text(encoding="utf-8")
    path = tmp_path / "documented.yaml"
    path.write_text(text.split("```yaml\n")[1].split("```")[0])
    array = MicrophoneArray.load(path)
    assert array.channels == (2, 3, 4, 5)
    assert array.steering == RigidSphereKind(0.0707)
    assert all(f"`{name}`" in text for name in PRESETS)

from pathlib import Path

import numpy as np
import pytest

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS, resolve_array
from avssl_pyro.errors import InputError


@pytest.mark.parametrize("count", [2, 4, 6])
def test_paper_circles_are_exact_sub_arrays_of_the_rendered_one(count: int) -> None:
    circle = PRESETS[f"circle{count}"]
    rendered = set(PRESETS["circle246"].positions_m)
    assert circle.num_microphones == count
    assert set(circle.positions_m) <= rendered
    assert np.linalg.norm(circle.positions, axis=-1) == pytest.approx([0.10] * count, abs=1e-9)
    assert circle.positions_m[0] == (0.1, 0.0, 0.0)
    azimuths = np.arctan2(circle.positions[:, 1], circle.positions[:, 0]) % (2 * np.pi)
    assert np.diff(azimuths) == pytest.approx([2 * np.pi / count] * (count - 1))


def test_respeaker_is_a_square_of_neighbours_45_7_mm_apart() -> None:
    positions = PRESETS["respeaker4"].positions
    sides = np.linalg.norm(positions - np.roll(positions, 1, axis=0), axis=-1)
    assert sides == pytest.approx([0.0457] * 4)
    assert np.linalg.norm(positions[0] - positions[2]) == pytest.approx(0.0457 * np.sqrt(2))
    assert (positions[:, 2] == 0).all()


def test_arrays_resolve_by_name_and_by_file(tmp_path: Path) -> None:
    assert resolve_array("circle4") is PRESETS["circle4"]
    path = tmp_path / "mine.yml"
    PRESETS["respeaker4"].save(path)
    assert resolve_array(str(path)) == PRESETS["respeaker4"]


def test_an_unknown_name_lists_the_known() -> None:
    with pytest.raises(InputError, match=r"'circle7' is neither a preset .*circle4.* nor a YAML file"):
        resolve_array("circle7")


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_survives_its_file_and_tells_directions_apart(name: str, tmp_path: Path) -> None:
    array = PRESETS[name]
    path = tmp_path / "array.yaml"
    array.save(path)
    assert MicrophoneArray.load(path) == array
    a_dm = array.steering_vectors(DirectionGrid(24), np.array([500.0, 1250.0, 2000.0])).numpy()
    alike_dd = np.abs(np.einsum("fdm,fem->fde", a_dm.conj(), a_dm)).mean(0) / array.num_microphones
    assert alike_dd.diagonal() == pytest.approx(np.ones(24))
    np.fill_diagonal(alike_dd, 0.0)
    # Two microphones do not know left from right, and so have one twin for every direction.
    twins = np.sum(alike_dd > 1 - 1e-6, axis=1)
    assert (twins == (1 if name == "circle2" else 0)).all()


@pytest.mark.parametrize(("name", "count", "diameter"), [("circle5", 5, 0.12), ("robot16", 16, 0.2)])
def test_other_circles(name: str, count: int, diameter: float) -> None:
    array = PRESETS[name]
    assert array.num_microphones == count
    assert np.linalg.norm(array.positions, axis=-1) == pytest.approx([diameter / 2] * count, abs=1e-9)


def test_respeaker6_is_a_circle_of_neighbours_one_radius_apart_on_six_of_eight_channels() -> None:
    array = PRESETS["respeaker6"]
    sides = np.linalg.norm(array.positions - np.roll(array.positions, 1, axis=0), axis=-1)
    assert sides == pytest.approx([0.0463] * 6)
    assert array.channel_indices == (0, 1, 2, 3, 4, 5)
    assert array.channels is not None


def test_the_tetrahedron_is_four_capsules_of_the_sphere_of_32() -> None:
    sphere, tetrahedron = PRESETS["eigenmike32"], PRESETS["starss23-mic"]
    assert sphere.select((5, 9, 25, 21), "starss23-mic") == tetrahedron
    assert tetrahedron.positions[0] == pytest.approx([0.02433, 0.02433, 0.02409], abs=1e-5)
    assert tetrahedron.positions[3] == pytest.approx([-0.02433, -0.02433, 0.02409], abs=1e-5)
    distances = np.linalg.norm(sphere.positions[:, None] - sphere.positions, axis=-1)
    # Capsules cover the sphere evenly: no two are close and none is alone.
    np.fill_diagonal(distances, np.inf)
    assert 0.020 < distances.min(1).min() <= distances.min(1).max() < 0.032

from pathlib import Path

import numpy as np
import pytest

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
    with pytest.raises(InputError, match=r"'circle5' is neither a preset .*circle4.* nor a YAML file"):
        resolve_array("circle5")

"""The table of combinations: what it holds, and that a stopped command goes on where it was."""

import json
import math
from pathlib import Path

import pytest
import torch

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.benchmarks import combinations
from avssl_pyro.benchmarks.combinations import recipes_for
from avssl_pyro.cli.benchmark import systems
from avssl_pyro.cli.options import choose_system
from avssl_pyro.errors import InputError
from avssl_pyro.models.likelihoods import ProfiledGaussian
from avssl_pyro.models.room import ROOM_DIFFUSE
from avssl_pyro.systems.config import GuideConfig, ModelConfig
from avssl_pyro.systems.system import SystemConfig, build_system


@pytest.fixture
def arguments(scene_folder: Path, tmp_path: Path) -> list[str]:
    data = ["--validation-data", str(scene_folder), "--test-data", str(scene_folder)]
    return [
        *data,
        "--num-validation-scenes",
        "2",
        "--num-test-scenes",
        "3",
        "--out",
        str(tmp_path),
        "--array",
        "circle2",
    ]


def test_rows_of_several_combinations_are_kept(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    systems.combinations([*arguments, "--num-combinations", "2"])
    rows = json.loads((tmp_path / "combinations.json").read_text())
    assert [row["guide"] for row in rows] == ["amortized", "refined"]
    # Both bounds are of the same clips under the same model, and the refined posterior is fitted to them.
    assert rows[1]["elbo"] > rows[0]["elbo"]
    assert all(0 <= row["f_measure"] <= 1 and row["ms_per_clip"] > 0 for row in rows)
    written = (tmp_path / "combinations.md").read_text()
    assert written.count("\n") == 2 + len(rows)
    assert "| refined |" in written
    assert "2 of 2: refined" in capsys.readouterr().out

    def run_again(*_: object) -> None:
        raise AssertionError("a kept row was run again")

    monkeypatch.setattr(combinations, "run_recipe", run_again)
    systems.combinations([*arguments, "--num-combinations", "2"])
    assert json.loads((tmp_path / "combinations.json").read_text()) == rows
    with pytest.raises(AssertionError, match="run again"):
        systems.combinations([*arguments, "--num-combinations", "2", "--seed", "1"])


def test_every_recipe_can_be_built_for_the_shipped_system() -> None:
    system, _ = choose_system(None, "circle4", "circle6")
    recipes = recipes_for(system)
    assert len({recipe.words for recipe in recipes}) == len(recipes) >= 8
    for recipe in recipes:
        combination = recipe.build(system)
        assert combination.model.likelihood == recipe.likelihood
        assert combination.model.bin_weight == system.model.bin_weight
        assert combination.model.room is system.model.room


def test_recipes_of_a_room_are_around_its_likelihood_and_every_guide_runs() -> None:
    sizes = ModelConfig(num_sources=2, num_directions=8, diffuse=ROOM_DIFFUSE, room=True)
    guide = GuideConfig(visual_channels=(4, 4), audio_channels=4)
    system = build_system(SystemConfig(PRESETS["circle4"], sizes, guide, StftConfig(window=64)))
    recipes = recipes_for(system)
    assert [recipe.likelihood for recipe in recipes[:3]] == [system.model.likelihood] * 2 + [ProfiledGaussian()]
    assert len({recipe.words for recipe in recipes}) == len(recipes)
    x_bfmt, image_bcij = torch.randn(1, 33, 4, 6, dtype=torch.complex64), torch.rand(1, 3, 16, 32)
    for recipe in {recipe.guide: recipe for recipe in reversed(recipes)}.values():
        assert math.isfinite(recipe.build(system).elbo(x_bfmt, image_bcij))


def test_no_scenes_and_damaged_rows_are_told(arguments: list[str], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--num-validation-scenes 0 and --num-test-scenes 3: both must be at least 1"):
        systems.combinations([*(argument if argument != "2" else "0" for argument in arguments)])
    systems.combinations([*arguments, "--num-combinations", "1"])
    (row,) = (tmp_path / "rows").iterdir()
    row.write_text("{")
    with pytest.raises(InputError, match=r"damaged .*; delete it and run the same command again"):
        systems.combinations([*arguments, "--num-combinations", "1"])

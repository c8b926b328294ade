"""evaluate.py --tables, from checkpoints and scenes to the three files, and on again after a stop."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import torch

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.benchmarks.paper import experiment
from avssl_pyro.benchmarks.result_tables import method_order
from avssl_pyro.cli import evaluate
from avssl_pyro.errors import InputError
from avssl_pyro.systems import pretrained
from avssl_pyro.systems.checkpoint import load_checkpoint, save_checkpoint
from avssl_pyro.systems.config import GuideConfig
from avssl_pyro.systems.system import System, SystemConfig, build_system

SETS = [f"{condition}-{split}" for condition in ("all-speak", "some-silent") for split in ("validation", "test")]
CONDITIONS, MICROPHONES = ("all-speak", "some-silent"), (2, 4)


def save_small(path: Path, array: str, seed: int = 0) -> Path:
    torch.manual_seed(seed)
    guide = GuideConfig(visual_channels=(4, 8), audio_channels=8)
    stft = StftConfig(low_hz=300.0, high_hz=2000.0)
    save_checkpoint(path, build_system(SystemConfig(PRESETS[array], guide=guide, stft=stft)))
    return path


@pytest.fixture(scope="module")
def arguments(tmp_path_factory: pytest.TempPathFactory, scene_folder: Path) -> list[str]:
    """A finished run: what was given to it; the last argument is its folder."""
    folder = tmp_path_factory.mktemp("tables")
    scenes = folder / "scenes"
    scenes.mkdir()
    for name in SETS:
        (scenes / name).symlink_to(scene_folder, target_is_directory=True)
    checkpoints = [save_small(folder / f"{array}.safetensors", array) for array in ("circle4", "circle2")]
    given = [word for checkpoint in checkpoints for word in ("--checkpoint", str(checkpoint))]
    short = ["--workers", "1", "--rounds", "2", "--same-band"]
    words = ["--tables", *given, "--sets", str(scenes), *short, "--out", str(folder / "out")]
    evaluate.main(words)
    return words


@pytest.fixture
def run_forbidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(condition: str, array: Any, *_: Any) -> None:
        raise RuntimeError(f"{condition} M={array.num_microphones} is run again")

    monkeypatch.setattr(experiment, "run_condition", refuse)


def test_every_cell_is_there_with_intervals_around_its_value(arguments: list[str]) -> None:
    data = json.loads((Path(arguments[-1]) / "tables.json").read_text())
    cells = {
        (row["condition"], row["microphones"], row["method"], row["tolerance_deg"], row["sources"]): row
        for row in data["rows"]
    }
    for condition in CONDITIONS:
        for microphones in MICROPHONES:
            for method in method_order():
                for tolerance in (5.0, 10.0, 15.0, 20.0):
                    row = cells[condition, microphones, method, tolerance, "all"]
                    assert row["clips"] == 10
                    assert row["f_low"] <= row["f_measure"] <= row["f_high"]
                    assert row["count_low"] <= row["count_accuracy"] <= row["count_high"]
    assert cells["some-silent", 4, "srp-phat", 10.0, "all"]["f_measure"] > 0.4
    figures = {(item["table"], item["method"], item["microphones"], item["sources"]): item for item in data["paper"]}
    assert figures["II", "Proposed", 4, 3]["value"] == 0.73
    runs = {(run["condition"], run["microphones"], run["method"]): run for run in data["runs"]}
    assert all(runs["all-speak", 4, method]["ms_per_clip"] > 0 for method in method_order()[2:])
    assert {"least", "cells", "merge_deg"} == set(runs["some-silent", 2, "amortized"]["setting"])
    believers = {(item["condition"], item["microphones"], item["method"]) for item in data["calibration"]}
    assert believers == {(c, m, name) for c in CONDITIONS for m in MICROPHONES for name in ("amortized", "refined")}
    assert all(0 <= item["area"] <= 1 for item in data["talking"])
    # The system's own bins of 31.25 Hz within 300 to 2000 Hz; the upper end is left out.
    assert data["settings"]["cells"][0]["baseline_band_hz"] == [312.5, 2031.25]


def test_the_page_and_the_picture_are_there(arguments: list[str]) -> None:
    out = Path(arguments[-1])
    page = (out / "tables.md").read_text()
    for title in ("Table I: F-measure, all-speak", "Table II: F", "Table III: count", "## Where we are behind"):
        assert title in page
    assert "| Proposed (paper) | 0.70 | 0.70 | 0.77 | 0.73 | 0.78 | 0.74 |" in page
    assert (out / "roc.png").read_bytes().startswith(b"\x89PNG")


def test_a_second_run_reads_every_cell_and_says_the_same(
    arguments: list[str], run_forbidden: None, capsys: pytest.CaptureFixture[str]
) -> None:
    out = Path(arguments[-1])
    before = {name: (out / name).read_bytes() for name in ("tables.json", "tables.md")}
    evaluate.main(arguments)
    assert capsys.readouterr().out.count("kept from before") == 4
    assert {name: (out / name).read_bytes() for name in before} == before


def test_a_stopped_run_goes_on_with_the_cell_it_was_in(arguments: list[str], run_forbidden: None) -> None:
    (cell,) = (Path(arguments[-1]) / "cells").glob("some-silent-M2-*.json")
    content = cell.read_bytes()
    cell.unlink()
    with pytest.raises(RuntimeError, match="some-silent M=2 is run again"):
        evaluate.main(arguments)
    cell.write_bytes(content)


def test_other_weights_under_the_same_name_are_run_anew(
    arguments: list[str], run_forbidden: None, tmp_path: Path
) -> None:
    changed = save_small(tmp_path / "circle4.safetensors", "circle4", seed=1)
    place = arguments.index("--checkpoint") + 1
    with pytest.raises(RuntimeError, match="all-speak M=4 is run again"):
        evaluate.main([*arguments[:place], str(changed), *arguments[place + 1 :]])


def test_another_setting_is_run_anew(arguments: list[str], run_forbidden: None) -> None:
    with pytest.raises(RuntimeError, match="is run again"):
        evaluate.main(["3" if word == "2" else word for word in arguments])


def test_without_checkpoints_the_shipped_weights_are_compared(
    arguments: list[str], run_forbidden: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def shipped(name: str) -> System:
        asked.append(name)
        return load_checkpoint(save_small(tmp_path / f"{name}.safetensors", name))

    monkeypatch.setattr(pretrained, "load_weights_of", shipped)
    scenes = arguments[arguments.index("--sets") + 1]
    with pytest.raises(RuntimeError, match="all-speak M=2 is run again"):
        evaluate.main(["--tables", "--sets", scenes, "--out", str(tmp_path / "out")])
    assert asked == ["circle2", "circle4", "circle6"]


def test_a_damaged_cell_is_named(arguments: list[str], tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(arguments[-1], out)
    (cell,) = (out / "cells").glob("all-speak-M4-*.json")
    cell.write_text(cell.read_text()[:200])
    with pytest.raises(InputError, match=r"all-speak-M4-\w+\.json: damaged .*delete it"):
        evaluate.main([*arguments[:-1], str(out)])


def test_bad_input_is_told_before_anything_runs(
    arguments: list[str], run_forbidden: None, scene_folder: Path, tmp_path: Path
) -> None:
    folder = str(scene_folder)
    checkpoint = arguments[arguments.index("--checkpoint") + 1]
    one = ["--checkpoint", checkpoint]
    for words, message in [
        (["--tables", *one, *one], "a second checkpoint for 4 microphones"),
        (["--tables", *one, "--test-data", folder], "give --sets instead"),
        ([*one, "--sets", folder, "--test-data", folder], "leave out --validation-data and --test-data"),
        (["--tables", *one, "--array", "circle4"], "leave out --array"),
        ([*one, "--array", "circle6"], "trained for array 'circle4' with 4 microphones, but 'circle6' has 6"),
        ([*arguments[1:]], "2 checkpoints were given; give one, or add --tables"),
        (["--tables", *one, "--sets", str(tmp_path / "none")], "no such folder; give one that contains"),
        (["--tables", *one, "--sets", str(tmp_path)], "all-speak-validation: no manifest.json"),
    ]:
        with pytest.raises(InputError, match=message):
            evaluate.main(words)

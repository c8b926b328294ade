import json
import subprocess
import sys
from pathlib import Path
from typing import get_args, get_type_hints

import cv2
import distributed
import numpy as np
import pytest

from avssl_pyro.cli.simulate import SimulateOptions, main
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.acoustics.models import ROOM_MODELS
from avssl_pyro.simulation.scene_config import SCENE_CONFIGS

SCRIPT = Path(__file__).parents[2] / "scripts" / "simulate.py"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("simulate") / "scenes"
    assert main(["--out", str(out), "--num-scenes", "3", "--shard-size", "2", "--workers", "1", "--seed", "4"]) == 0
    return out


def test_scenes_are_made_and_verified(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dataset = SceneDataset(folder)
    assert [dataset[index].audio_mn.shape for index in range(3)] == [(8, 16000)] * 3
    assert main(["--verify", str(folder)]) == 0
    assert capsys.readouterr().out == f"{folder}: sound.\n"


def test_unsound_scenes_are_named_with_exit_code_1(folder: Path, tmp_path: Path) -> None:
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    shard = tmp_path / "scenes-000001.tar"
    shard.write_bytes(shard.read_bytes()[:5000])
    finished = subprocess.run(
        [sys.executable, SCRIPT, "--verify", tmp_path], capture_output=True, text=True, check=False
    )
    assert finished.returncode == 1
    assert "scenes-000001.tar is truncated" in finished.stdout
    assert finished.stdout.count("\n") == 1


def test_bad_input_is_one_sentence_with_exit_code_2(tmp_path: Path) -> None:
    nowhere = tmp_path / "nowhere"
    finished = subprocess.run(
        [sys.executable, SCRIPT, "--out", tmp_path / "out", "--speech", nowhere],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert finished.returncode == 2
    assert finished.stderr.startswith(f"error: {nowhere}: no such folder")
    assert finished.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ([], "say what to do"),
        (["--out", "x", "--num-scenes", "0"], "--num-scenes is 0"),
        (["--out", "x", "--shard-size", "-1"], "scenes_per_shard is -1"),
        (["--out", "x", "--seed", "-1"], "--seed is -1"),
        (["--out", "x", "--array", "circle7"], "neither a preset"),
        (["--out", "x", "--workers", "-5"], "--workers is -5"),
    ],
)
def test_impossible_wishes_are_refused_before_anything_is_written(
    args: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        main(args)
    assert list(tmp_path.iterdir()) == []


def test_another_condition_in_the_same_folder_is_refused(folder: Path) -> None:
    with pytest.raises(InputError, match="'some-silent', not 'all-speak'"):
        main(
            ["--out", str(folder), "--num-scenes", "3", "--shard-size", "2", "--seed", "4", "--condition", "all-speak"]
        )


def test_every_condition_can_be_asked_for() -> None:
    assert set(get_args(get_type_hints(SimulateOptions)["condition"])) == set(SCENE_CONFIGS)
    acoustics = get_args(get_args(get_type_hints(SimulateOptions)["acoustics"])[0])
    assert set(acoustics) == set(ROOM_MODELS)


def test_a_dask_scheduler_makes_the_same_scenes(folder: Path, tmp_path: Path) -> None:
    cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None)  # type: ignore[no-untyped-call]
    with cluster:
        args = ["--out", str(tmp_path), "--num-scenes", "3", "--shard-size", "2", "--seed", "4"]
        assert main([*args, "--scheduler", cluster.scheduler_address]) == 0
    made = json.loads((tmp_path / "manifest.json").read_text())
    assert made == json.loads((folder / "manifest.json").read_text())


@pytest.mark.parametrize("stored", [True, False])
def test_a_contact_sheet_of_stored_or_new_scenes_is_written(folder: Path, tmp_path: Path, stored: bool) -> None:
    sheet = tmp_path / "new" / "sheet.png"
    args = ["--preview", str(sheet), "--num-scenes", "3", "--shard-size", "2", "--seed", "4"]
    assert main([*args, "--out", str(folder)] if stored else args) == 0
    image_ijc = cv2.imread(str(sheet))
    assert image_ijc is not None
    assert image_ijc.shape[1] > 1500
    assert np.unique(image_ijc.reshape(-1, 3), axis=0).shape[0] > 1000

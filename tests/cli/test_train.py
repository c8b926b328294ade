"""svi_train.py: presets, defaults, continuation, and refusals in one sentence."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from avssl_pyro.cli.command import run
from avssl_pyro.cli.train import main, parse
from avssl_pyro.systems.checkpoint import load_checkpoint
from avssl_pyro.systems.pretrained import load_weights_of
from avssl_pyro.training.svi import CHECKPOINT_NAME

SMALL = ["--guide.visual-channels", "4", "8", "--guide.audio-channels", "8", "--optimization.batch-size", "4"]
FAST = [*SMALL, "--optimization.epochs", "1", "--optimization.num-workers", "0", "--optimization.log-every", "1"]


def options(folder: Path, out: Path, *more: str) -> list[str]:
    return ["--data", str(folder), "--out", str(out), "--array", "circle2", *FAST, *more]


def test_a_preset_gives_defaults_that_options_override() -> None:
    paper = parse(["--preset", "paper", "--optimization.epochs", "3"])
    assert (paper.num_scenes, paper.optimization.epochs) == (20_000, 3)
    assert paper.optimization.learning_rate == 1e-3
    assert (paper.model.num_sources, paper.model.alpha, paper.model.sigma) == (4, 0.01, 1.0)
    assert paper.model.num_directions == 72


def test_shipped_weights_are_adapted_to_another_array_by_their_name(scene_folder: Path, tmp_path: Path) -> None:
    few = ["--optimization.epochs", "1", "--optimization.batch-size", "4"]
    main(["--preset", "adapt", "--data", str(scene_folder), "--array", "circle2", "--out", str(tmp_path), *few])
    adapted, shipped = load_checkpoint(tmp_path / CHECKPOINT_NAME), load_weights_of("circle6")
    assert adapted.config.array.name == "circle2"
    before = shipped.guide.state_dict()
    same = {name: value.equal(before[name]) for name, value in adapted.guide.state_dict().items()}
    assert all(equal for name, equal in same.items() if name.startswith("visual."))
    assert not all(same.values())


def test_help_explains_every_preset_and_option(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_info:
        main(["--help"])
    assert exit_info.value.code == 0
    text = capsys.readouterr().out
    for word in (
        "quick",
        "two-cores",
        "paper",
        "adapt",
        "--optimization.learning-rate",
        "--model.alpha",
        "concentration",
    ):
        assert word in text


def test_without_data_a_small_set_is_made_and_cached(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--cache", str(tmp_path / "cache"), "--num-scenes", "8", "--array", "circle4", *FAST]
    main(["--out", str(tmp_path / "first"), *arguments])
    (manifest,) = (tmp_path / "cache").glob("*/manifest.json")
    made = manifest.stat().st_mtime_ns
    main(["--out", str(tmp_path / "second"), *arguments])
    assert manifest.stat().st_mtime_ns == made
    for name in ("checkpoint.safetensors", "checkpoint.json", "curves.png", "log.jsonl", "run.json", "tensorboard"):
        assert (tmp_path / "first" / name).exists(), name
    assert load_checkpoint(tmp_path / "first" / CHECKPOINT_NAME).config.array.name == "circle4"
    first, second = (load_checkpoint(tmp_path / run / CHECKPOINT_NAME).state_dict() for run in ("first", "second"))
    assert all(value.equal(second[name]) for name, value in first.items())


def test_other_settings_in_the_same_folder_are_refused(
    scene_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(options(scene_folder, tmp_path))
    with pytest.raises(SystemExit) as exit_info:
        run(lambda: main(options(scene_folder, tmp_path, "--model.alpha", "0.5")))
    assert exit_info.value.code == 2
    message = capsys.readouterr().err.splitlines()[-1]
    assert "started with model.alpha = 0.01, not 0.5" in message


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["--array", "broken.yaml"], "cannot read the array file"),
        (["--array", "respeaker4"], "respeaker4"),
        (["--data", "nowhere"], "nowhere"),
        (["--optimization.batch-size", "100"], "10 clips do not fill one batch of 100"),
        pytest.param(
            ["--accelerator", "cuda"],
            "--accelerator cuda",
            marks=pytest.mark.skipif(torch.cuda.is_available(), reason="there is one"),
        ),
    ],
)
def test_bad_input_gets_one_sentence(
    more: list[str],
    says: str,
    scene_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as exit_info:
        run(lambda: main(options(scene_folder, tmp_path / "run", *more)))
    assert exit_info.value.code == 2
    assert says in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "run" / CHECKPOINT_NAME).exists()
    # What was wrong must not stand in the way of the corrected command.
    assert main(options(scene_folder, tmp_path / "run")) == 0


def test_a_full_disk_keeps_the_last_checkpoint(
    scene_folder: Path, tmp_path: Path, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    main(options(scene_folder, tmp_path))
    kept = (tmp_path / CHECKPOINT_NAME).read_bytes()
    (tmp_path / "training_state.pt").unlink()

    request.getfixturevalue("full_disk")
    with pytest.raises(SystemExit) as exit_info:
        run(lambda: main(options(scene_folder, tmp_path)))
    assert exit_info.value.code == 2
    assert "no space is left on the disk" in capsys.readouterr().err.splitlines()[-1]
    assert (tmp_path / CHECKPOINT_NAME).read_bytes() == kept
    assert not list(tmp_path.glob(".*partial"))
    assert json.loads((tmp_path / "run.json").read_text())["array"]["name"] == "circle2"


@pytest.mark.timeout(240)
@pytest.mark.parametrize("launcher", [["--devices", "2"], ["-m", "torch.distributed.run", "--nproc-per-node", "2"]])
def test_the_whole_guide_trains_on_two_processes(scene_folder: Path, tmp_path: Path, launcher: list[str]) -> None:
    script = str(Path(__file__).parents[2] / "scripts" / "svi_train.py")
    arguments = [*options(scene_folder, tmp_path / "run"), "--accelerator", "cpu", "--devices", "2"]
    # The weight of the targets is nothing at the first step, so there must be a second.
    arguments += ["--targets.warmup", "0", "--optimization.epochs", "2"]
    torchrun = launcher if launcher[0] == "-m" else []
    done = subprocess.run(
        [sys.executable, *torchrun, script, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        timeout=200,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    # Ten clips in global batches of eight: one step an epoch, told once.
    records = [json.loads(line) for line in (tmp_path / "run" / "log.jsonl").read_text().splitlines()]
    assert [record["step"] for record in records] == [1, 2]
    assert records[-1]["direction_cross_entropy"] > 0
    assert done.stdout.count("written") == 1
    assert load_checkpoint(tmp_path / "run" / CHECKPOINT_NAME).config.array.name == "circle2"

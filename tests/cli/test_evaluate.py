"""avssl evaluate, gallery, demo, and benchmark elbo and speed, each run small from end to end."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
import torch

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.benchmarks import elbo
from avssl_pyro.cli import demo, evaluate, gallery
from avssl_pyro.cli.benchmark import systems
from avssl_pyro.errors import InputError
from avssl_pyro.systems.checkpoint import save_checkpoint
from avssl_pyro.systems.config import GuideConfig, ModelConfig
from avssl_pyro.systems.system import SystemConfig, build_system

FIELDS = {
    "condition",
    "microphones",
    "sources",
    "method",
    "tolerance_deg",
    "f_measure",
    "precision",
    "recall",
    "count_accuracy",
    "localization_error_deg",
    "clips",
}
SMALL = GuideConfig(visual_channels=(4, 8), audio_channels=8)


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("checkpoint") / "small.safetensors"
    save_checkpoint(path, build_system(SystemConfig(PRESETS["circle4"], ModelConfig(bin_weight=3.0), SMALL)))
    return path


def test_the_report_has_every_method_and_field(checkpoint: Path, scene_folder: Path, tmp_path: Path) -> None:
    folder = str(scene_folder)
    sets = ["--validation-data", folder, "--test-data", folder, "--workers", "1"]
    evaluate.main(["--checkpoint", str(checkpoint), "--out", str(tmp_path), *sets])
    rows = json.loads((tmp_path / "report.json").read_text())
    assert all(set(row) >= FIELDS for row in rows)
    headline = {row["method"]: row for row in rows if row["sources"] == "all" and row["tolerance_deg"] == 10}
    assert set(headline) >= {"music", "norm-music", "srp-phat", "amortized", "no-audio-net", "random"}
    assert headline["srp-phat"]["f_measure"] > headline["random"]["f_measure"] + 0.2
    assert all(row["clips"] == 10 for row in headline.values())
    assert "srp-phat" in (tmp_path / "report.md").read_text()


def test_the_comparison_agrees_and_a_wrong_prior_would_not(
    checkpoint: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    short = ["--seconds", "0.05", "--num-clips", "1", "--num-draws", "8"]
    assert systems.elbo(["--checkpoint", str(checkpoint), *short]) == 0
    assert "agree." in capsys.readouterr().out
    # The closed form reads its priors from the configuration; another alpha than the model's must be noticed.
    system = elbo.double_precision

    def with_another_alpha(given):  # type: ignore[no-untyped-def]
        double = system(given)
        double.model.level_prior = type(double.model.level_prior)(0.5)
        return double

    monkeypatch.setattr(elbo, "double_precision", with_another_alpha)
    assert systems.elbo(["--checkpoint", str(checkpoint), *short]) == 1
    assert "DISAGREE" in capsys.readouterr().out


def test_the_comparison_of_a_room_agrees(capsys: pytest.CaptureFixture[str]) -> None:
    short = ["--seconds", "0.05", "--num-clips", "1", "--num-draws", "8"]
    assert systems.elbo(["--model.room", "--model.diffuse", "0.01", *short]) == 0
    assert "KL of e" in capsys.readouterr().out


@pytest.mark.parametrize("main", [systems.elbo, lambda words: gallery.main(["--data", "none", *words])])
def test_a_checkpoint_of_another_array_is_refused(main: Callable[[Sequence[str]], object], checkpoint: Path) -> None:
    with pytest.raises(InputError, match=r"small\.safetensors: trained for array 'circle4' with 4 microphones, but"):
        main(["--checkpoint", str(checkpoint), "--array", "circle6"])


def test_the_demo_leaves_what_it_promises(tmp_path: Path) -> None:
    sizes = ["--num-scenes", "16", "--num-test-scenes", "6", "--num-validation-scenes", "6", "--num-overlays", "4"]
    training = ["--optimization.epochs", "1", "--optimization.num-workers", "0"]
    demo.main(["--out", str(tmp_path / "demo"), "--cache", str(tmp_path / "cache"), *sizes, *training])
    names = {path.name for path in (tmp_path / "demo").iterdir()}
    assert names >= {"report.json", "report.md", "curves.png", "checkpoint.safetensors"}
    assert len([name for name in names if name.startswith("overlay-")]) == 4
    first = {path.name for path in (tmp_path / "demo" / "first").iterdir()}
    assert "overlay.png" in first
    assert any(name.startswith("source") and name.endswith(".wav") for name in first)


def test_the_benchmark_prints_its_ratio(capsys: pytest.CaptureFixture[str]) -> None:
    systems.speed(["--array", "circle2", "--batch-size", "2", "--num-repeats", "2"])
    text = capsys.readouterr().out
    assert "Pyro / plain torch:" in text
    assert "amortized" in text

"""avssl benchmark calibration end to end, on very few scenes."""

import json
from pathlib import Path

import pytest

from avssl_pyro.cli.benchmark.systems import calibration
from avssl_pyro.errors import InputError


def test_it_prints_a_table_and_goes_on_where_it_stopped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--out", str(tmp_path), "--posteriors", "refined", "--batch-size", "2"]
    calibration([*arguments, "--num-trials", "2"])
    calibration([*arguments, "--num-trials", "4"])
    output = capsys.readouterr().out
    assert "largest level" in output
    assert "log likelihood" in output
    assert (tmp_path / "ranks.png").stat().st_size > 1000
    content = json.loads((tmp_path / "ranks.json").read_text())
    assert len(content["ranks"]["refined"]["mean log w"]) == 4
    assert content["uniformity"]["refined"]["mean log w"]["trials"] == 4
    # The first two trials were kept.
    assert len(list((tmp_path / "trials").iterdir())) == 2


def test_the_small_model_may_have_a_room(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    calibration(["--out", str(tmp_path), "--posteriors", "refined", "--num-trials", "2", "--room"])
    assert "log likelihood" in capsys.readouterr().out


def test_an_unknown_posterior_and_no_trials_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no 'exact'; choose from refined"):
        calibration(["--out", str(tmp_path), "--posteriors", "exact"])
    with pytest.raises(InputError, match="at least 1"):
        calibration(["--out", str(tmp_path), "--num-trials", "0"])

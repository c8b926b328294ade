from collections.abc import Callable
from pathlib import Path

import pytest

from avssl_pyro.benchmarks.camera import CameraExperiment, CameraTrial
from avssl_pyro.cli.benchmark.recordings import camera
from avssl_pyro.errors import InputError


def test_trials_are_kept_and_shown(
    checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "camera"
    args = ["--array", "circle4", "--checkpoint", str(checkpoint), "--seconds", "8", "--width", "288"]
    camera([*args, "--out", str(out), "--num-recordings", "1"])
    printed = capsys.readouterr().out
    assert "recordings of 8 s" in printed
    (stored,) = out.iterdir()

    def run_again(*_: object) -> None:
        raise AssertionError("a stored recording was run again")

    monkeypatch.setattr(CameraExperiment, "run", run_again)
    camera([*args, "--out", str(out), "--num-recordings", "1"])
    assert capsys.readouterr().out == printed
    with pytest.raises(AssertionError, match="run again"):
        camera([*args, "--out", str(out), "--num-recordings", "1", "--seed", "1"])
    stored.write_text('{"settings": {}, "result": {"index": 0}}')
    with pytest.raises(InputError, match=r"00000-\w+\.json: damaged .*; delete it"):
        camera([*args, "--out", str(out), "--num-recordings", "1"])


def test_no_recordings_are_refused(refusal: Callable[[Callable[[], int | None]], str]) -> None:
    assert "at least 1 recording" in refusal(lambda: camera(["--num-recordings", "0"]))


@pytest.mark.parametrize(
    ("found_deg", "mirror", "decided", "right"),
    [(-178.0, True, True, True), (-170.0, True, True, False), (178.0, False, True, False), (178.0, True, False, False)],
)
def test_a_trial_is_right_only_in_all_respects(found_deg: float, mirror: bool, decided: bool, right: bool) -> None:
    assert CameraTrial(0, 178.0, True, found_deg, mirror, 1.0, decided).right == right

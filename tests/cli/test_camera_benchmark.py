from collections.abc import Callable
from pathlib import Path

import pytest

from avssl_pyro.benchmarks.camera import CameraTrial
from avssl_pyro.cli.camera_benchmark import main


def test_trials_are_kept_and_shown(checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "camera.jsonl"
    args = ["--array", "circle4", "--checkpoint", str(checkpoint), "--seconds", "8", "--width", "288"]
    main([*args, "--out", str(out), "--recordings", "1"])
    assert "recordings of 8 s" in capsys.readouterr().out
    kept = out.read_text()
    assert kept.count("\n") == 1
    main([*args, "--out", str(out), "--recordings", "1"])
    assert out.read_text() == kept


def test_other_settings_and_foreign_files_are_refused(
    checkpoint: Path, tmp_path: Path, refusal: Callable[[Callable[[], int | None]], str]
) -> None:
    out = tmp_path / "camera.jsonl"
    args = ["--array", "circle4", "--checkpoint", str(checkpoint), "--out", str(out)]
    out.write_text('{"settings": {}, "index": 0}\n')
    assert "holds something else" in refusal(lambda: main(args))
    out.write_text(
        '{"settings": {}, "index": 0, "yaw_deg": 1, "mirror": true, "found_yaw_deg": 2, "found_mirror": true, '
        '"confidence": 1, "told": true}\n'
    )
    assert "of other settings" in refusal(lambda: main(args))
    assert "at least 1 recording" in refusal(lambda: main([*args, "--recordings", "0"]))


@pytest.mark.parametrize(
    ("found_deg", "mirror", "told", "right"),
    [(-178.0, True, True, True), (-170.0, True, True, False), (178.0, False, True, False), (178.0, True, False, False)],
)
def test_a_trial_is_right_only_in_all_respects(found_deg: float, mirror: bool, told: bool, right: bool) -> None:
    assert CameraTrial(0, 178.0, True, found_deg, mirror, 1.0, told).right == right

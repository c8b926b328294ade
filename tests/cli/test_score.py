from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile

from avssl_pyro.cli.score import main


@pytest.fixture
def files(tmp_path: Path) -> tuple[str, str]:
    """One talker in frames 0 to 9; found 8 degrees off in all of them and heard 15 off by a second file in half."""
    labels, estimates = tmp_path / "labels.csv", tmp_path / "found.csv"
    labels.write_text("".join(f"{frame},1,0,176,5,150\n" for frame in range(10)))
    estimates.write_text(
        "".join(f"{frame},0,3,-176,0\n" for frame in range(10)) + "".join(f"{frame},0,4,60,0\n" for frame in range(5))
    )
    return str(labels), str(estimates)


def rows(text: str) -> list[list[str]]:
    return [line.split() for line in text.splitlines() if "found.csv" in line or "random" in line]


def test_directions_are_scored_by_frame_across_the_seam(
    files: tuple[str, str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    main(["--labels", files[0], "--estimates", files[1], "--tolerances-deg", "10", "5"])
    near, random, far, _ = rows(capsys.readouterr().out)
    assert near[-5:] == ["0.800", "0.667", "1.000", "8.0°", "0.500"]
    assert far[-5:] == ["0.000", "0.000", "0.000", "–", "0.500"]
    assert random[-1] == "1.000"


def test_baselines_stand_beside(
    files: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    audio = tmp_path / "noise.wav"
    soundfile.write(audio, 0.1 * np.random.default_rng(0).standard_normal((48_000, 4)), 24_000)
    main(["--labels", files[0], "--estimates", files[1], "--audio", str(audio)])
    out = capsys.readouterr().out
    assert "20 frames, 10 labelled directions" in out
    assert all(name in out for name in ("srp-phat", "music", "norm-music, tuned"))


def test_what_cannot_be_scored_is_refused(
    files: tuple[str, str], tmp_path: Path, refusal: Callable[[Callable[[], int | None]], str]
) -> None:
    empty = tmp_path / "empty.csv"
    empty.write_text("")
    assert "--tolerances-deg has 0" in refusal(
        lambda: main(["--labels", files[0], "--estimates", files[1], "--tolerances-deg", "0"])
    )
    assert "nothing to score" in refusal(lambda: main(["--labels", str(empty), "--estimates", str(empty)]))
    assert "no such file of labels" in refusal(lambda: main(["--labels", "nowhere.csv", "--estimates", files[1]]))

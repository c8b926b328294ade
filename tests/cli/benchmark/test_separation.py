"""The separation benchmark, and what docs/separation.md shows, which runs as it stands there."""

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest
import soundfile

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.cli import localize
from avssl_pyro.cli.benchmark.recordings import separation
from avssl_pyro.datasets.dataset import SceneDataset

PAGE = (Path(__file__).parents[3] / "docs" / "separation.md").read_text(encoding="utf-8")


def command_of(name: str) -> list[str]:
    (command,) = re.findall(rf"^avssl {name}((?:.|\\\n)*?[^\\])$", PAGE, re.MULTILINE)
    return shlex.split(command.replace("\\\n", " "))


@pytest.fixture
def user_folder(scene_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    scene = SceneDataset(scene_folder, PRESETS["circle6"])[0]
    cv2.imwrite(str(tmp_path / "panorama.jpg"), cv2.cvtColor(scene.image_ijc, cv2.COLOR_RGB2BGR))
    soundfile.write(tmp_path / "clip.flac", scene.audio_mn.T, 16_000, subtype="PCM_24")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("user_folder")
def test_command_and_example_separate_the_same_sources() -> None:
    localize.main(command_of("localize"))
    named = [source["separated"] for source in json.loads(Path("result.json").read_text())["sources"]]
    assert len(named) >= 2
    (example,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    scope: dict[str, object] = {}
    exec(compile(example, "docs/separation.md", "exec"), scope)
    for name, sound_n in zip(named, scope["sound_sn"], strict=True):  # type: ignore[call-overload]
        written_n, _ = soundfile.read(name, dtype="float32")
        assert written_n == pytest.approx(sound_n, abs=1e-6)
    assert scope["by_mvdr_sn"].shape == scope["sound_sn"].shape  # type: ignore[attr-defined]


def test_benchmark_of_the_page(checkpoint: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = command_of("benchmark separation")
    small = ["--num-scenes", "1", "--array", "circle4", "--checkpoint", str(checkpoint)]
    separation([*words[: words.index("--speech")], *small])
    printed = capsys.readouterr().out
    assert "1 mixtures of two talkers, seed 302" in printed
    for way in ("delay and sum", "refined: Wiener", "one pass: MVDR", "oracle masks", "above delay"):
        assert way in printed


def test_a_benchmark_of_no_scenes_is_refused(refusal: Callable[[Callable[[], int | None]], str]) -> None:
    assert "--num-scenes is 0" in refusal(lambda: separation(["--num-scenes", "0"]))

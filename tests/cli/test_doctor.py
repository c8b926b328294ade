"""doctor.py: exit codes, one line a finding, JSON, and one sentence for bad input."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import soundfile
import torch

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.cli.doctor import main
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.systems.checkpoint import save_checkpoint
from avssl_pyro.systems.config import GuideConfig
from avssl_pyro.systems.system import SystemConfig, build_system

ARRAY = PRESETS["circle4"]


@pytest.fixture
def recording(scene_folder: Path, tmp_path: Path) -> Path:
    """A recording of three seconds."""
    dataset = SceneDataset(scene_folder, ARRAY)
    audio_mn = np.concatenate([dataset[index].audio_mn for index in range(3)], axis=1)
    path = tmp_path / "talk.wav"
    soundfile.write(path, audio_mn.T, 16_000, subtype="FLOAT")
    return path


def test_a_good_recording_gives_lines_and_zero(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--audio", str(recording), "--array", "circle4"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert all(line.startswith(("ok ", "note ")) for line in lines)
    assert any("spatial aliasing starts at" in line for line in lines)


def test_a_dead_channel_gives_one(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    samples, rate = soundfile.read(recording)
    samples[:, 1] = 0
    soundfile.write(recording, samples, rate)
    assert main(["--audio", str(recording), "--array", "circle4", "--json"]) == 1
    content = json.loads(capsys.readouterr().out)
    assert content["format"] == "avssl-diagnosis/1"
    worst = [finding for finding in content["findings"] if finding["severity"] == "error"]
    assert [finding["check"] for finding in worst] == ["levels"]
    assert worst[0]["message"] == "channel 2 is dead: constant throughout"
    assert worst[0]["confidence"] == 1.0
    assert worst[0]["advice"]


def test_shards_are_examined_as_the_array_that_is_asked_for(
    scene_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--data", str(scene_folder), "--array", "circle2"]) == 0
    assert "front-back ambiguity" in capsys.readouterr().out


def test_a_checkpoint_judges_the_camera(scene_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    torch.manual_seed(0)
    path = tmp_path / "small.safetensors"
    small = GuideConfig(visual_channels=(4, 8), audio_channels=8)
    save_checkpoint(path, build_system(SystemConfig(ARRAY, guide=small)))
    main(["--data", str(scene_folder), "--array", "circle4", "--checkpoint", str(path), "--json"])
    findings = json.loads(capsys.readouterr().out)["findings"]
    (camera,) = [finding for finding in findings if finding["check"] == "camera"]
    # Untrained, it has seen nothing that could make it sure.
    assert camera["severity"] == "note"
    assert "undetermined" in camera["message"]


def test_the_picture_of_a_video_is_compared_with_the_sound(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(4)
    moments_s = np.sort(rng.uniform(2, 14, 12))
    dry_n = 1e-4 * rng.standard_normal(16 * 16_000)
    writer = cv2.VideoWriter(str(tmp_path / "flashes.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (192, 96))
    for moment_s in moments_s:
        start = int(moment_s * 16_000)
        dry_n[start : start + 1600] += 0.3 * rng.standard_normal(1600)
    for frame in range(16 * 25):
        lit = bool(np.any((frame / 25 >= moments_s + 0.48) & (frame / 25 < moments_s + 0.56)))
        writer.write(np.full((96, 192, 3), 200 if lit else 60, np.uint8))
    writer.release()
    audio_mn = np.stack([dry_n, np.roll(dry_n, 3)]) + 1e-4 * rng.standard_normal((2, len(dry_n)))
    soundfile.write(tmp_path / "claps.wav", audio_mn.T, 16_000)
    files = ["--audio", str(tmp_path / "claps.wav"), "--video", str(tmp_path / "flashes.avi"), "--array", "circle2"]
    assert main(files) == 1
    out = capsys.readouterr().out
    assert re.search(r"warning audio-video offset: the picture comes 0\.(4[4-9]|5\d) s after the sound", out)
    assert re.search(r"read it with an offset of -0\.(4[4-9]|5\d) s", out)
    assert main([*files, "--offset=-0.5"]) == 0


def test_a_picture_that_is_none_of_360_degrees_is_refused(
    recording: Path, refusal: Callable[[Callable[[], int | None]], str]
) -> None:
    image = recording.with_name("fisheye.png")
    circle_ijc = np.zeros((160, 320, 3), np.uint8)
    cv2.circle(circle_ijc, (160, 80), 78, (150, 150, 150), -1)
    for picture_ijc, says in (
        (circle_ijc, "one fisheye picture on black"),
        (circle_ijc[:, 80:240], "160 x 160 pixels"),
    ):
        cv2.imwrite(str(image), picture_ijc)
        words = ["--audio", str(recording), "--image", str(image), "--array", "circle4"]
        assert f"fisheye.png: {says}" in refusal(lambda words=words: main(words))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "give --audio FILE or --data FOLDER"),
        (["--audio", "missing.wav", "--array", "circle4"], "missing.wav: no such audio file"),
        (["--audio", "talk.wav"], "give --array"),
        (["--audio", "talk.wav", "--array", "circle6"], "4 channel(s), but array 'circle6' has 6"),
        (["--audio", "talk.wav", "--array", "circle4", "--video", "missing.mp4"], "missing.mp4: no such video file"),
        (["--audio", "talk.wav", "--array", "circle4", "--camera"], "give --video or --image as well"),
        (["--audio", "talk.wav", "--data", "scenes"], "either --data or files"),
    ],
)
def test_bad_input_gets_one_sentence(
    arguments: list[str],
    says: str,
    recording: Path,
    monkeypatch: pytest.MonkeyPatch,
    refusal: Callable[[Callable[[], int | None]], str],
) -> None:
    monkeypatch.chdir(recording.parent)
    assert says in refusal(lambda: main(arguments))

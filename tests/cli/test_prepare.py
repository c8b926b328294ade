"""prepare.py on recordings and STARSS23, and training on what it makes."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import soundfile
from recorded import write_frames, write_noise, write_video

from avssl_pyro.cli.command import run
from avssl_pyro.cli.prepare import main
from avssl_pyro.cli.train import main as train
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.errors import InputError
from avssl_pyro.io.video_writer import open_video
from avssl_pyro.recordings.starss23 import list_starss
from avssl_pyro.systems.checkpoint import load_checkpoint

SCRIPT = Path(__file__).parents[2] / "scripts" / "prepare.py"


def fails(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as exit_info:
        run(lambda: main(arguments))
    assert exit_info.value.code == 2
    return capsys.readouterr().err.splitlines()[-1]


def test_museum_training_runs_on_clips_of_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = tmp_path / "in", tmp_path / "out"
    for name in ("day1", "day2"):
        write_noise(folder / f"{name}.wav", [0.1, 0.05, 0.2])
        write_video(folder / f"{name}.mp4", 30)
    write_noise(folder / "alone.wav", [0.1])
    main(["--recordings", str(folder), "--out", str(out), "--array", "circle4", "--num-clips", "4", "--yaw", "10"])
    captured = capsys.readouterr()
    assert f"{out}: 4 clips in 1 shards" in captured.out
    assert "alone.wav: has no partner" in captured.err
    small = ["--guide.visual-channels", "4", "8", "--guide.audio-channels", "8", "--optimization.batch-size", "2"]
    train(
        ["--preset", "museum", "--data", str(out), "--out", str(tmp_path / "run"), "--optimization.epochs", "1", *small]
    )
    config = load_checkpoint(tmp_path / "run" / "checkpoint.safetensors").config
    assert config.array.name == "circle4"
    model = config.model
    assert (model.num_sources, model.alpha, model.sigma, model.diffuse) == (8, 1.0, 1.0, 0.1)


def test_museum_without_clips_is_refused() -> None:
    with pytest.raises(InputError, match=r"preset museum.*needs --data"):
        train(["--preset", "museum"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "give one recording, --video with --audio, or several"),
        (["--video", "v.mp4"], "give both --video and --audio"),
        (["--recordings", "nowhere", "--audio", "a.wav"], "give one recording, --video with --audio, or several"),
        (["--recordings", "nowhere"], "nowhere: no such file or folder; give a folder of videos and audio files"),
        (["--video", "none.mp4", "--audio", "none.wav"], "none.wav: no such audio file"),
        (["--recordings", "x", "--num-clips", "-1"], "--num-clips is -1"),
    ],
)
def test_bad_options_end_in_one_sentence(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert words in fails(["--out", str(tmp_path / "out"), "--array", "circle4", *arguments], capsys)


def test_a_video_that_was_cut_off_gives_the_clips_that_it_still_shows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its index, in front, names all of its frames."""
    video, out = tmp_path / "walk.mp4", tmp_path / "out"
    rng = np.random.default_rng(0)
    with open_video(video, 320, 160, 10.0) as writer:
        for index in range(60):
            writer.write(rng.integers(0, 256, (160, 320, 3), dtype=np.uint8), index / 10)
    content = video.read_bytes()
    video.write_bytes(content[: len(content) * 6 // 10])
    write_noise(tmp_path / "walk.wav", [0.1] * 6)
    main(["--video", str(video), "--audio", str(tmp_path / "walk.wav"), "--array", "circle4", "--out", str(out)])
    captured = capsys.readouterr()
    clips = len(SceneDataset(out))
    assert 3 <= clips <= 4
    assert f"{6 - clips} clip(s) have no picture, the first at {clips}.0 s, where the video has a gap" in captured.err


def dead_channel(folder: Path) -> None:
    samples_nm, rate = soundfile.read(folder / "walk.wav")
    samples_nm[:, 2] = 0
    soundfile.write(folder / "walk.wav", samples_nm, rate)


def five_channels(folder: Path) -> None:
    write_noise(folder / "walk.wav", [0.1] * 3, num_channels=5)


def digital_silence(folder: Path) -> None:
    write_noise(folder / "walk.wav", [0.0] * 3, constant=0.0)


def one_fisheye(folder: Path) -> None:
    frame_ijc = np.zeros((160, 320, 3), np.uint8)
    cv2.circle(frame_ijc, (160, 80), 78, (150, 150, 150), -1)
    write_frames(folder / "walk.mp4", [frame_ijc] * 30)


@pytest.mark.parametrize(
    ("breakage", "says"),
    [
        (dead_channel, "walk.wav: channel 3 is dead, constant throughout"),
        (five_channels, "walk.wav: 5 channel(s), but array 'circle4' has 4 microphones"),
        (digital_silence, "no clip of 1 s has both sound above -100 dB of full scale and a picture"),
        (one_fisheye, "walk.mp4: one fisheye picture on black; export it as equirectangular"),
    ],
)
def test_a_bad_recording_is_refused_before_anything_is_written(
    breakage: Callable[[Path], None], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_noise(tmp_path / "walk.wav", [0.1] * 3)
    write_video(tmp_path / "walk.mp4", 30)
    breakage(tmp_path)
    words = ["--video", str(tmp_path / "walk.mp4"), "--audio", str(tmp_path / "walk.wav"), "--array", "circle4"]
    assert says in fails([*words, "--out", str(tmp_path / "out")], capsys)
    assert not (tmp_path / "out").exists()


def talker_frame() -> np.ndarray:
    """Somebody at +90 degrees: around column 480 of 1920."""
    frame_ijc = np.zeros((960, 1920, 3), np.uint8)
    frame_ijc[460:500, 460:500] = 255
    return frame_ijc


@pytest.fixture
def starss(tmp_path: Path) -> Path:
    """Two recordings in STARSS23's format, one in each kind of folder; the second has no video."""
    root = tmp_path / "STARSS23"
    names = ("dev-train-sony/fold3_room21_mix013", "dev-train-tau/fold3_room4_mix001")
    for audio_format in ("mic", "foa"):
        for name in names:
            write_noise(root / f"{audio_format}_dev" / f"{name}.wav", [0.1, 0.1], 4, 24_000, "PCM_16")
    write_frames(root / "video_dev" / f"{names[0]}.mp4", [talker_frame()] * 60, 29.97)
    labels = root / "metadata_dev" / f"{names[0]}.csv"
    labels.parent.mkdir(parents=True)
    lines = [f"{frame},1,0,90,-5,180" for frame in range(10)] + [f"{frame},0,2,88,3,200" for frame in range(8)]
    labels.write_text("\n".join(lines) + "\n")
    return root


@pytest.mark.parametrize("audio_format", ["mic", "foa"])
def test_starss_is_read_with_its_labels_and_on_the_right_side(
    starss: Path, audio_format: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = list_starss(starss, audio_format, "dev-train")
    assert [(entry.fold, entry.room, entry.mix, entry.video is None) for entry in files] == [
        (3, 21, 13, False),
        (3, 4, 1, True),
    ]
    out = tmp_path / "out"
    main(["--recordings", str(starss), "--format", audio_format, "--out", str(out)])
    assert "1 of 2 recordings have no video" in capsys.readouterr().err
    dataset = SceneDataset(out)
    assert (len(dataset), dataset.array.name) == (2, f"starss23-{audio_format}")
    # Rows of one source that two classes claim, two degrees apart, are one direction.
    assert np.rad2deg(dataset.labels(0).talker_azimuths) == pytest.approx([89.15], abs=0.2)
    assert dataset.labels(1).talker_azimuths == ()
    columns_j = dataset[0].image_ijc.mean(axis=(0, 2))
    azimuth_deg = 180 - 360 * (np.average(np.arange(288), weights=columns_j**2) + 0.5) / 288
    assert azimuth_deg == pytest.approx(90, abs=2)
    assert columns_j[:144].sum() > 0.99 * columns_j.sum()


def test_starss_videos_may_lie_without_a_folder_between(starss: Path) -> None:
    video = starss / "video_dev" / "dev-train-sony" / "fold3_room21_mix013.mp4"
    video.rename(starss / "video_dev" / video.name)
    assert list_starss(starss, "mic", "dev-train")[0].video == starss / "video_dev" / video.name
    with pytest.raises(InputError, match="no recordings"):
        list_starss(starss, "mic", "dev-test")
    with pytest.raises(InputError, match="has no labels"):
        list_starss(starss, "mic", "dev-train")[1].read_labels()


def test_the_script_tells_bad_input_without_a_traceback(tmp_path: Path) -> None:
    write_noise(tmp_path / "a.wav", [0.1, 0.1])
    video = write_video(tmp_path / "a.mp4", 20)
    video.write_bytes(video.read_bytes()[:2000])
    command = [
        sys.executable,
        str(SCRIPT),
        "--recordings",
        str(tmp_path),
        "--out",
        str(tmp_path / "out"),
        "--array",
        "circle4",
    ]
    finished = subprocess.run(command, capture_output=True, text=True, check=False)
    assert finished.returncode == 2
    assert finished.stderr.count("\n") == 1
    assert "a.mp4: cannot be read as video; it is truncated" in finished.stderr

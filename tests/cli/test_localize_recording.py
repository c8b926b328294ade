"""localize.py on a whole recording: its results, their interruption, and one sentence for everything that is wrong."""

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import soundfile

from avssl_pyro.cli.localize import main
from avssl_pyro.interruption import GracefulInterrupt
from avssl_pyro.io.dcase import read_dcase
from avssl_pyro.io.video_writer import open_video

ROWS, COLUMNS, FRAME_RATE, SECONDS = 160, 320, 10.0, 3
ALL_CLASSES = ("--least-level", "0")


@pytest.fixture
def recording(tmp_path: Path) -> tuple[Path, Path]:
    """Three seconds of somebody who walks to the right, as a camera and a 24 kHz recorder take them."""
    video, audio = tmp_path / "walk.mp4", tmp_path / "walk.wav"
    with open_video(video, COLUMNS, ROWS, FRAME_RATE) as out:
        for index in range(round(SECONDS * FRAME_RATE)):
            frame_ijc = np.full((ROWS, COLUMNS, 3), 120, np.uint8)
            frame_ijc[50:130, 40 + 4 * index : 60 + 4 * index] = (180, 60, 60)
            out.write(frame_ijc, index / FRAME_RATE)
    noise_nm = np.random.default_rng(0).normal(0, 0.1, (24_000 * SECONDS, 4))
    soundfile.write(audio, noise_nm, 24_000, subtype="PCM_24")
    return video, audio


def arguments(checkpoint: Path, recording: tuple[Path, Path], out: Path, *more: str) -> list[str]:
    video, audio = (str(path) for path in recording)
    rounds = () if "--rounds" in more else ("--rounds", "0")
    return ["--checkpoint", str(checkpoint), "--video", video, "--audio", audio, "--out", str(out), *rounds, *more]


def lines_of(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_a_recording_gives_lines_csv_and_a_video(
    checkpoint: Path, recording: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, table, annotated = tmp_path / "new" / "out.jsonl", tmp_path / "out.csv", tmp_path / "out.mp4"
    more = ("--dcase", str(table), "--annotated", str(annotated), "--no-tracking", *ALL_CLASSES)
    assert main(arguments(checkpoint, recording, out, *more)) == 0
    assert "21 results over 3.0 s" in capsys.readouterr().out
    lines = lines_of(out)
    assert [line["time_s"] for line in lines] == pytest.approx(np.arange(0.5, 2.55, 0.1))
    for line in lines:
        assert line["format"] == "avssl-window/1"
        sources = line["sources"]
        assert isinstance(sources, list) and sources
        assert {"source_class", "azimuth_deg", "azimuth_std_deg", "level"} == set(sources[0])
        assert [source["level"] for source in sources] == sorted((s["level"] for s in sources), reverse=True)
    rows = read_dcase(table)
    # A 100-ms frame has the result of the window around it; the ends have that of the nearest.
    assert sorted({row.frame for row in rows}) == list(range(30))
    first = lines[0]["sources"]
    assert isinstance(first, list)
    expected = {source["source_class"]: source["azimuth_deg"] for source in first}
    assert {row.source: row.azimuth_deg for row in rows if row.frame == 0} == pytest.approx(expected, abs=0.06)
    with av.open(str(annotated)) as container:
        assert container.streams.video[0].codec_context.name == "h264"
        assert container.streams.audio[0].codec_context.name == "aac"
        frames = list(container.decode(video=0))
    assert [frame.time for frame in frames] == pytest.approx(np.arange(30) / FRAME_RATE, abs=1e-3)
    assert frames[0].width == 960


def test_tracks_have_numbers_and_refined_results_come_twice_a_second(
    checkpoint: Path, recording: tuple[Path, Path], tmp_path: Path
) -> None:
    out = tmp_path / "out.jsonl"
    assert main(arguments(checkpoint, recording, out, "--rounds", "1", *ALL_CLASSES)) == 0
    lines = lines_of(out)
    assert [line["time_s"] for line in lines] == pytest.approx([0.5, 1.0, 1.5, 2.0, 2.5])
    for line in lines:
        sources = line["sources"]
        assert isinstance(sources, list)
        assert all({"track", "azimuth_deg", "azimuth_std_deg", "level"} == set(source) for source in sources)


def test_a_softer_channel_is_named_once_for_all_windows(
    checkpoint: Path, recording: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    samples_nm, rate = soundfile.read(recording[1])
    soundfile.write(recording[1], samples_nm * [1, 0.25, 1, 1], rate, subtype="PCM_24")
    assert main(arguments(checkpoint, recording, tmp_path / "out.jsonl")) == 0
    warnings = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning:")]
    assert warnings == [
        f"warning: {recording[1]}: channel 2 is 12 dB softer than the others; 'avssl doctor' checks the channels."
    ]


def test_the_command_of_the_page_works(
    recording: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (Path(__file__).parents[2] / "docs" / "recordings.md").read_text(encoding="utf-8")
    commands = re.findall(r"^avssl localize (.*?[^\\])$", page, re.DOTALL | re.MULTILINE)
    (command,) = (command for command in commands if "walk.mp4" in command)
    monkeypatch.chdir(tmp_path)
    words = shlex.split(command.replace("\\\n", " "))
    words += ["--rounds", "1"]
    assert main(words) == 0
    assert {"walk.jsonl", "walk.csv", "walk-annotated.mp4"} <= {path.name for path in tmp_path.iterdir()}


class Impatient(GracefulInterrupt):
    """Somebody who presses ctrl-C after a few windows."""

    asked = 0

    @property
    def requested(self) -> bool:
        self.asked += 1
        return self.asked > 5

    @requested.setter
    def requested(self, value: bool) -> None:
        pass


def test_an_interrupted_run_leaves_whole_lines_and_says_how_far_it_came(
    checkpoint: Path,
    recording: tuple[Path, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("avssl_pyro.interruption.GracefulInterrupt", Impatient)
    out, table, annotated = tmp_path / "out.jsonl", tmp_path / "out.csv", tmp_path / "out.mp4"
    more = ("--dcase", str(table), "--annotated", str(annotated), "--no-tracking", *ALL_CLASSES)
    assert main(arguments(checkpoint, recording, out, *more)) == 130
    assert "interrupted at 1.5 s of 3.0 s" in capsys.readouterr().err
    assert [line["time_s"] for line in lines_of(out)] == pytest.approx([0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
    assert {row.frame for row in read_dcase(table)} == set(range(15))
    assert not annotated.exists()


def test_a_video_that_was_cut_off_is_localized_as_far_as_it_goes_and_that_is_said(
    checkpoint: Path, recording: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video, _ = recording
    rng = np.random.default_rng(0)
    with open_video(video, COLUMNS, ROWS, FRAME_RATE) as writer:
        for index in range(round(SECONDS * FRAME_RATE)):
            writer.write(rng.integers(0, 256, (ROWS, COLUMNS, 3), dtype=np.uint8), index / FRAME_RATE)
    content = video.read_bytes()
    video.write_bytes(content[: len(content) // 3])
    assert main(arguments(checkpoint, recording, tmp_path / "out.jsonl")) == 0
    lines = lines_of(tmp_path / "out.jsonl")
    assert 10 <= len(lines) < 21
    assert f"walk.mp4: {21 - len(lines)} windows have no picture" in capsys.readouterr().err


def no_overlap(_video: Path, _audio: Path) -> list[str]:
    return ["--offset", "100"]


def short_overlap(_video: Path, _audio: Path) -> list[str]:
    return ["--offset", "2.5"]


def missing_audio(_video: Path, audio: Path) -> list[str]:
    audio.unlink()
    return []


def missing_video(video: Path, _audio: Path) -> list[str]:
    video.unlink()
    return []


def truncated_video(video: Path, _audio: Path) -> list[str]:
    video.write_bytes(video.read_bytes()[:600])
    return []


def dead_channel(_video: Path, audio: Path) -> list[str]:
    samples_nm, rate = soundfile.read(audio)
    samples_nm[:, 0] = 0
    soundfile.write(audio, samples_nm, rate)
    return []


def fisheye(video: Path, _audio: Path) -> list[str]:
    circle_ijc = np.zeros((ROWS, COLUMNS, 3), np.uint8)
    cv2.circle(circle_ijc, (COLUMNS // 2, ROWS // 2), ROWS // 2 - 2, (150, 150, 150), -1)
    with open_video(video, COLUMNS, ROWS, FRAME_RATE) as out:
        for index in range(round(SECONDS * FRAME_RATE)):
            out.write(circle_ijc, index / FRAME_RATE)
    return []


def damaged_flac(_video: Path, audio: Path) -> list[str]:
    flac = audio.with_suffix(".flac")
    soundfile.write(flac, soundfile.read(audio)[0], 24_000)
    content = flac.read_bytes()
    flac.write_bytes(content[: len(content) // 2])
    return ["--audio", str(flac)]


def three_channels(_video: Path, audio: Path) -> list[str]:
    samples_nm, rate = soundfile.read(audio)
    soundfile.write(audio, samples_nm[:, :3], rate)
    return []


def folder_as_output(video: Path, _audio: Path) -> list[str]:
    return ["--dcase", str(video.parent)]


def video_as_output(video: Path, _audio: Path) -> list[str]:
    return ["--annotated", str(video)]


def same_output(video: Path, _audio: Path) -> list[str]:
    return ["--dcase", str(video.parent / "out.jsonl")]


def unknown_extension(video: Path, _audio: Path) -> list[str]:
    return ["--annotated", str(video.with_name("out.avi"))]


def no_rate(_video: Path, _audio: Path) -> list[str]:
    return ["--rate", "0"]


def image_as_well(video: Path, _audio: Path) -> list[str]:
    return ["--image", str(video)]


@pytest.mark.parametrize(
    ("breakage", "says"),
    [
        (no_overlap, "have no moment in common at an offset of 100 s"),
        (short_overlap, "sound and picture have 0.50 s in common; a result needs 1 s"),
        (missing_audio, "walk.wav: no such audio file"),
        (missing_video, "walk.mp4: no such video file"),
        (truncated_video, "walk.mp4: cannot be read as video"),
        (dead_channel, "walk.wav: channel 1 is dead, constant throughout"),
        (fisheye, "walk.mp4: one fisheye picture on black; export it as equirectangular"),
        (damaged_flac, "walk.flac: cannot be read as audio"),
        (three_channels, "walk.wav: 3 channel(s), but array 'circle4' has 4 microphones"),
        (folder_as_output, "is not a regular file"),
        (video_as_output, "walk.mp4: is read or written by the same command already"),
        (same_output, "out.jsonl: is read or written by the same command already"),
        (unknown_extension, "out.avi: videos are written as H.264 or VP9"),
        (no_rate, "--rate is 0; give a number of results per second"),
        (image_as_well, "--image is for single clips"),
    ],
)
def test_bad_input_gets_one_sentence_and_leaves_nothing(
    breakage: Callable[[Path, Path], list[str]],
    says: str,
    checkpoint: Path,
    recording: tuple[Path, Path],
    tmp_path: Path,
    refusal: Callable[[Callable[[], int | None]], str],
) -> None:
    more = breakage(*recording)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert says in refusal(lambda: main(arguments(checkpoint, recording, tmp_path / "out.jsonl", *more)))
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("option", ["--dcase", "--annotated"])
def test_outputs_of_recordings_need_one(
    option: str,
    checkpoint: Path,
    recording: tuple[Path, Path],
    tmp_path: Path,
    refusal: Callable[[Callable[[], int | None]], str],
) -> None:
    files = ["--image", str(recording[0]), "--audio", str(recording[1]), "--out", str(tmp_path / "out.json")]
    message = refusal(lambda: main(["--checkpoint", str(checkpoint), *files, option, str(tmp_path / "out.mp4")]))
    assert f"{option} is for whole recordings; give --video with --audio" in message

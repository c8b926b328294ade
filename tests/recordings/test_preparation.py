import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded import frame_number, stretch_frame, write_noise, write_video

from avssl_pyro.acoustics.presets import PRESETS, uniform_circle
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.errors import InputError
from avssl_pyro.io.audio import AudioFile
from avssl_pyro.io.video_reader import VideoFile
from avssl_pyro.recordings.preparation import CuttingConfig, Prepared, prepare
from avssl_pyro.recordings.recording import Recording
from avssl_pyro.recordings.split import ByRecording, ByTime

LEVELS = ([0.01, 0.05, 0.02, 0.0, 0.0, 0.0, 0.04, 0.001], [0.03, 0.002, 0.06])


def recording(folder: Path, name: str, levels: list[float], **settings: object) -> Recording:
    audio = AudioFile(write_noise(folder / f"{name}.wav", levels))
    video = VideoFile(write_video(folder / f"{name}.mp4", 10 * len(levels)))
    return Recording(name, audio, video, **settings)  # type: ignore[arg-type]


@pytest.fixture
def recordings(tmp_path: Path) -> tuple[Recording, ...]:
    return tuple(recording(tmp_path / "in", f"day{number}", levels) for number, levels in enumerate(LEVELS))


def cut(folder: Path, recordings: tuple[Recording, ...], **settings: object) -> Prepared:
    settings = {"cutting": CuttingConfig(loudest=4), "scenes_per_shard": 3} | settings
    return prepare(folder, recordings, PRESETS["circle4"], workers=1, progress=False, **settings)  # type: ignore[arg-type]


def keys(dataset: SceneDataset) -> list[str]:
    return [dataset[index].key for index in range(len(dataset))]


def test_the_loudest_clips_are_cut_with_their_pictures_and_without_labels(
    recordings: tuple[Recording, ...], tmp_path: Path
) -> None:
    made = cut(tmp_path / "out", recordings)
    dataset = SceneDataset(tmp_path / "out")
    assert keys(dataset) == ["day0-00001000", "day0-00006000", "day1-00000000", "day1-00002000"]
    assert dataset.array == PRESETS["circle4"]
    for index, (number, start_s) in enumerate(((0, 1), (0, 6), (1, 0), (1, 2))):
        clip = dataset[index]
        np.testing.assert_allclose(clip.audio_mn, recordings[number].audio.read(start_s, 1.0), atol=1 / 32768)
        assert frame_number(clip.image_ijc) == 10 * start_s + 5
        assert dataset.metadata(index)["recording"] == f"day{number}"
        # A third of the noise lies above what 16 kHz hold.
        assert dataset.metadata(index)["rms"] == pytest.approx(LEVELS[number][start_s] * (2 / 3) ** 0.5, rel=0.05)
        with pytest.raises(InputError, match=rf"'{clip.key}'.*has no labels"):
            dataset.labels(index)
    assert made.remarks == ("day0: 1 clip(s) are silent; they are left out.",)


def test_the_channels_of_an_array_are_read_by_its_map_unless_the_recording_says_otherwise(
    recordings: tuple[Recording, ...], tmp_path: Path
) -> None:
    array = replace(PRESETS["circle2"], channels=(4, 2))
    swapped = (recordings[0], replace(recordings[1], channels=(0, 3)))
    prepare(tmp_path / "out", swapped, array, CuttingConfig(loudest=4), workers=1, progress=False)
    dataset = SceneDataset(tmp_path / "out")
    assert dataset[0].audio_mn.mean(axis=1) == pytest.approx([0.03, 0.01], abs=0.002)
    assert dataset[2].audio_mn.mean(axis=1) == pytest.approx([0.0, 0.03], abs=0.002)


def test_a_quiet_recording_keeps_its_detail(tmp_path: Path) -> None:
    quiet = recording(tmp_path / "in", "quiet", [1e-4, 2e-4])
    cut(tmp_path / "out", (quiet,))
    error_mn = SceneDataset(tmp_path / "out")[0].audio_mn - quiet.audio.read(0.0, 1.0)
    assert 20 * np.log10(error_mn.std() / 1e-4) < -50


def test_a_second_run_goes_on_and_other_settings_are_refused(
    recordings: tuple[Recording, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    cut(out, recordings)
    before = {path.name: (path.stat().st_mtime_ns, path.read_bytes()) for path in out.iterdir()}
    (out / "scenes-000001.tar").unlink()
    # What was heard is not heard again.
    monkeypatch.setattr(Recording, "audio_windows", None)
    cut(out, recordings)
    after = {path.name: (path.stat().st_mtime_ns, path.read_bytes()) for path in out.iterdir()}
    assert {name: content for name, (_, content) in after.items()} == {
        name: content for name, (_, content) in before.items()
    }
    assert [name for name in before if before[name][0] != after[name][0]] == ["scenes-000001.tar"]
    with pytest.raises(InputError, match=r"cut with cutting\.loudest = 4, not 3"):
        cut(out, recordings, cutting=CuttingConfig(loudest=3))


def test_clips_without_a_picture_are_left_out_and_said(tmp_path: Path) -> None:
    audio = AudioFile(write_noise(tmp_path / "a.wav", [0.1] * 7))
    stretch_frame(write_video(tmp_path / "a.mp4", 40), 15, 26)
    made = cut(tmp_path / "out", (Recording("a", audio, VideoFile(tmp_path / "a.mp4")),), cutting=CuttingConfig())
    # Frame 15 stands from 1.5 to 4.1 s, but shows nothing after 2.5 s.
    assert keys(SceneDataset(tmp_path / "out")) == [f"a-{second:08d}" for second in (0, 1000, 2000, 4000, 5000)]
    assert any("1 clip(s) have no picture, the first at 3.0 s" in remark for remark in made.remarks)


def test_validation_is_kept_apart_by_recording_or_time(recordings: tuple[Recording, ...], tmp_path: Path) -> None:
    by_recording, by_time = tmp_path / "by-recording", tmp_path / "by-time"
    cut(by_recording, recordings, splitter=ByRecording(0.5, seed=1))
    parts = [set(keys(SceneDataset(by_recording / name))) for name in ("train", "validation")]
    assert sorted({key.split("-")[0] for key in part} for part in parts) in ([{"day0"}, {"day1"}], [{"day1"}, {"day0"}])
    cut(by_time, recordings, splitter=ByTime(0.4), cutting=CuttingConfig(hop_s=0.5))
    border_s = {"day0": 4.8, "day1": 1.8}
    for part in ("train", "validation"):
        for key in keys(SceneDataset(by_time / part)):
            name, start_ms = key.split("-")
            start_s = int(start_ms) / 1e3
            assert start_s + 1.0 <= border_s[name] if part == "train" else start_s >= border_s[name]
    with pytest.raises(InputError, match="only one recording"):
        cut(tmp_path / "one", recordings[:1], splitter=ByRecording())


def test_what_cannot_be_cut_is_refused_in_one_sentence(recordings: tuple[Recording, ...], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"4 channel\(s\), but array 'circle5' has 5"):
        prepare(tmp_path / "out", recordings, uniform_circle(5), CuttingConfig(), progress=False)
    with pytest.raises(InputError, match=r"2 channel\(s\) are to be read, but array 'circle4' has 4"):
        cut(tmp_path / "out", (replace(recordings[0], channels=(0, 1)),))
    write_noise(tmp_path / "silent.wav", [0.0, 0.0], constant=0.0)
    write_video(tmp_path / "silent.mp4", 20)
    silent = Recording("silent", AudioFile(tmp_path / "silent.wav"), VideoFile(tmp_path / "silent.mp4"))
    with pytest.raises(InputError, match=r"no clip of 1 s has both sound.*silent: 2 clip"):
        cut(tmp_path / "out", (silent,))
    audio = AudioFile(write_noise(tmp_path / "a.wav", [0.1] * 2))
    portrait = VideoFile(write_video(tmp_path / "p.mp4", 20, (96, 192)))
    with pytest.raises(InputError, match=r"p\.mp4: 96 x 192 pixels"):
        cut(tmp_path / "out", (Recording("p", audio, portrait),))
    assert not (tmp_path / "out").exists()


def test_different_lengths_are_said(tmp_path: Path) -> None:
    audio = AudioFile(write_noise(tmp_path / "a.wav", [0.1] * 2))
    video = VideoFile(write_video(tmp_path / "a.mp4", 40))
    made = cut(tmp_path / "out", (Recording("a", audio, video),))
    assert made.remarks == ("a: its audio lasts 2.00 s, its video 4.00 s; the 2.00 s that both have are used.",)
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["num_scenes"] == 2

"""localize.py: its result, its picture, and one sentence for everything that can be wrong with the input."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import soundfile
from scipy.signal import resample_poly

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.cli.localize import main, parse
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.localization.direct_level import ONE_PASS_RULE, DirectLevelRule

ARRAY = PRESETS["circle4"]


@pytest.fixture
def clip(scene_folder: Path, tmp_path: Path) -> tuple[Path, Path]:
    """An image and a recording as a user has them."""
    scene = SceneDataset(scene_folder, ARRAY)[0]
    image, audio = tmp_path / "pano.png", tmp_path / "clip.wav"
    cv2.imwrite(str(image), cv2.cvtColor(scene.image_ijc, cv2.COLOR_RGB2BGR))
    soundfile.write(audio, scene.audio_mn.T, 16_000, subtype="FLOAT")
    return image, audio


def arguments(checkpoint: Path, image: Path, audio: Path, out: Path, *more: str) -> list[str]:
    files = ["--checkpoint", str(checkpoint), "--image", str(image), "--audio", str(audio), "--out", str(out)]
    return [*files, *more]


def test_the_result_is_documented_and_the_overlay_a_picture(
    checkpoint: Path, clip: tuple[Path, Path], tmp_path: Path
) -> None:
    out, overlay = tmp_path / "result.json", tmp_path / "overlay.png"
    main(arguments(checkpoint, *clip, out, "--overlay", str(overlay), "--least-level", "0", "--array", "circle4"))
    result = json.loads(out.read_text())
    assert result["format"] == "avssl-result/1"
    assert np.array(result["direction_weights"]).shape == (4, 72)
    assert np.array(result["direction_weights"]).sum(1) == pytest.approx(1, abs=1e-3)
    assert sum(result["mixing_levels"]) == pytest.approx(1, abs=1e-4)
    assert result["directions_deg"][:2] == [177.5, 172.5]
    assert result["sources"]
    for source in result["sources"]:
        assert -180 <= source["azimuth_deg"] < 180
        assert source["azimuth_std_deg"] > 0
        assert 0 <= source["level"] <= 1
        assert source["level_std"] >= 0
    picture = cv2.imread(str(overlay))
    assert picture is not None
    assert picture.shape[1] >= 1152


def test_the_help_states_the_defaults_of_the_rule(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse(["--help"])
    printed = " ".join(capsys.readouterr().out.replace("\u2502", " ").split())
    assert f"By default {DirectLevelRule().least}, or {ONE_PASS_RULE.least} with --rounds 0" in printed


def test_another_rate_and_a_full_sphere_give_the_same_sources(
    checkpoint: Path, clip: tuple[Path, Path], tmp_path: Path
) -> None:
    image, audio = clip
    samples, _ = soundfile.read(audio)
    resampled, sphere = tmp_path / "clip48.flac", tmp_path / "sphere.png"
    soundfile.write(resampled, np.clip(resample_poly(samples, 3, 1, axis=0), -1, 1), 48_000, subtype="PCM_24")
    small_ijc = cv2.imread(str(image))
    # Rows -90..90 degrees: the clip's picture fills the middle 110 of 180 degrees.
    full_ijc = np.zeros((288, 576, 3), np.uint8)
    full_ijc[56:232] = cv2.resize(small_ijc, (576, 176), interpolation=cv2.INTER_NEAREST)
    cv2.imwrite(str(sphere), full_ijc)
    levels = []
    for number, (one_image, one_audio) in enumerate(((image, audio), (sphere, resampled))):
        out = tmp_path / f"{number}.json"
        main(arguments(checkpoint, one_image, one_audio, out))
        levels.append(json.loads(out.read_text()))
    assert levels[0]["mixing_levels"] == pytest.approx(levels[1]["mixing_levels"], abs=0.02)
    assert np.array(levels[0]["direction_weights"]) == pytest.approx(np.array(levels[1]["direction_weights"]), abs=1e-3)


def test_a_channel_map_finds_the_microphones_among_the_channels(
    checkpoint: Path, clip: tuple[Path, Path], tmp_path: Path
) -> None:
    image, audio = clip
    samples, rate = soundfile.read(audio)
    shuffled = np.concatenate([np.zeros((len(samples), 1)), samples[:, [2, 0, 3, 1]]], axis=1)
    other, array = tmp_path / "shuffled.wav", tmp_path / "mapped.yaml"
    soundfile.write(other, shuffled, rate, subtype="FLOAT")
    MicrophoneArray("mapped", ARRAY.positions_m, channels=(3, 5, 2, 4)).save(array)
    plain, mapped = tmp_path / "plain.json", tmp_path / "mapped.json"
    main(arguments(checkpoint, image, audio, plain))
    main(arguments(checkpoint, image, other, mapped, "--array", str(array)))
    results = [json.loads(path.read_text()) for path in (plain, mapped)]
    assert results[0]["mixing_levels"] == results[1]["mixing_levels"]
    assert results[1]["array"]["channels"] == [3, 5, 2, 4]


def test_a_manifest_gives_one_line_per_clip(checkpoint: Path, clip: tuple[Path, Path], tmp_path: Path) -> None:
    image, audio = clip
    manifest, out = tmp_path / "clips.csv", tmp_path / "results.jsonl"
    manifest.write_text(f"audio,image\n{audio.name},{image.name}\n{audio.name},{image.name}\n")
    overlays = tmp_path / "overlays"
    options = ["--checkpoint", str(checkpoint), "--clips", str(manifest), "--out", str(out)]
    main([*options, "--overlay", str(overlays)])
    lines = [json.loads(line) for line in out.read_text().splitlines()]
    assert len(lines) == 2
    assert lines[0]["mixing_levels"] == lines[1]["mixing_levels"]
    assert len(list(overlays.glob("*.png"))) == 2


def test_a_louder_channel_is_named_once_over_all_clips_and_undone(
    checkpoint: Path, clip: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image, audio = clip
    samples, rate = soundfile.read(audio)
    loud, manifest, out = tmp_path / "loud.wav", tmp_path / "clips.csv", tmp_path / "results.jsonl"
    soundfile.write(loud, samples * np.array([1, 1, -3, 1]) / 3, rate, subtype="FLOAT")
    manifest.write_text("audio,image\n" + f"{loud.name},{image.name}\n" * 3)
    main(["--checkpoint", str(checkpoint), "--clips", str(manifest), "--out", str(out)])
    warnings = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning:")]
    assert [line.split(";")[0] for line in warnings] == [
        f"warning: {manifest}: channel 3 is 9 dB louder than the others",
        f"warning: {manifest}: channel 3 has the opposite sign of the others",
    ]
    plain = tmp_path / "plain.json"
    main(arguments(checkpoint, image, audio, plain))
    assert "warning" not in capsys.readouterr().err
    expected = json.loads(plain.read_text())["mixing_levels"]
    for line in out.read_text().splitlines():
        assert json.loads(line)["mixing_levels"] == pytest.approx(expected, abs=0.05)


def three_channels(image: Path, audio: Path) -> list[str]:
    samples, rate = soundfile.read(audio)
    soundfile.write(audio, samples[:, :3], rate)
    return []


def no_samples(image: Path, audio: Path) -> list[str]:
    soundfile.write(audio, np.zeros((0, 4)), 16_000)
    return []


def nan_samples(image: Path, audio: Path) -> list[str]:
    samples, rate = soundfile.read(audio)
    samples[123, 2] = np.nan
    soundfile.write(audio, samples, rate, subtype="FLOAT")
    return []


def dead_channel(image: Path, audio: Path) -> list[str]:
    samples, rate = soundfile.read(audio)
    samples[:, 2] = 0
    soundfile.write(audio, samples, rate)
    return []


def fisheyes(image: Path, audio: Path) -> list[str]:
    circles_ijc = np.zeros((160, 320, 3), np.uint8)
    for column in (80, 240):
        cv2.circle(circles_ijc, (column, 80), 78, (150, 150, 150), -1)
    cv2.imwrite(str(image), circles_ijc)
    return []


def sofa_as_array(image: Path, audio: Path) -> list[str]:
    path = image.with_name("array.sofa")
    path.write_bytes(b"\x89HDF\r\n\x1a\n")
    return ["--array", str(path)]


def portrait(image: Path, audio: Path) -> list[str]:
    cv2.imwrite(str(image), np.zeros((640, 480, 3), np.uint8))
    return []


def missing_image(image: Path, audio: Path) -> list[str]:
    image.unlink()
    return []


def missing_audio(image: Path, audio: Path) -> list[str]:
    audio.unlink()
    return []


def text_as_audio(image: Path, audio: Path) -> list[str]:
    audio.write_text("not a recording")
    return []


def text_as_image(image: Path, audio: Path) -> list[str]:
    image.write_text("not a picture")
    return []


def empty_image(image: Path, audio: Path) -> list[str]:
    image.write_bytes(b"")
    return []


def huge_samples(image: Path, audio: Path) -> list[str]:
    samples, rate = soundfile.read(audio)
    samples[5, 1] = 1e30
    soundfile.write(audio, samples, rate, subtype="FLOAT")
    return []


def unknown_device(image: Path, audio: Path) -> list[str]:
    return ["--device", "cuda:99"]


def too_long(image: Path, audio: Path) -> list[str]:
    soundfile.write(audio, np.zeros((16_000 * 11, 4)), 16_000)
    return []


def broken_yaml(image: Path, audio: Path) -> list[str]:
    path = image.with_name("array.yaml")
    path.write_text("positions_m: [[0, 0, 0], [0.1, 0\n")
    return ["--array", str(path)]


def other_count(image: Path, audio: Path) -> list[str]:
    return ["--array", "circle6"]


def other_places(image: Path, audio: Path) -> list[str]:
    return ["--array", "respeaker4"]


def other_kind(image: Path, audio: Path) -> list[str]:
    return ["--array", "starss23-foa"]


def channels_beyond(image: Path, audio: Path) -> list[str]:
    path = image.with_name("array.yaml")
    MicrophoneArray(ARRAY.name, ARRAY.positions_m, channels=(1, 2, 3, 9)).save(path)
    return ["--array", str(path)]


def unknown_array(image: Path, audio: Path) -> list[str]:
    return ["--array", "circle7"]


@pytest.mark.parametrize(
    ("breakage", "says"),
    [
        (three_channels, "clip.wav: 3 channel(s), but array 'circle4' has 4 microphones"),
        (no_samples, "clip.wav: 0 samples (0 ms); a clip needs at least 100 ms"),
        (nan_samples, "clip.wav: sample 123 of channel 3 is not a finite number"),
        (dead_channel, "clip.wav: channel 3 is dead, constant throughout"),
        (fisheyes, "pano.png: two fisheye pictures side by side; export it as equirectangular"),
        (sofa_as_array, "array.sofa is no text file; give a YAML file, which may name a SOFA file"),
        (portrait, "pano.png: 480 x 640 pixels; a 360-degree image is twice as wide as high"),
        (missing_image, "pano.png: no such image file"),
        (missing_audio, "clip.wav: no such audio file"),
        (text_as_audio, "clip.wav: cannot be read as audio"),
        (text_as_image, "pano.png: cannot be read as an image"),
        (empty_image, "pano.png: cannot be read as an image"),
        (huge_samples, "clip.wav: a sample is as large as 1e+30"),
        (unknown_device, "device 'cuda:99' cannot be used here"),
        (too_long, "clip.wav: 11.0 s long; a clip may last up to 10 s"),
        (broken_yaml, "array.yaml: not valid YAML"),
        (other_count, "trained for array 'circle4' with 4 microphones, but 'circle6' has 6"),
        (other_places, "trained for array 'circle4', whose microphone"),
        (other_kind, "trained for array 'circle4' in free field, but 'starss23-foa' is in first-order ambisonics"),
        (channels_beyond, "clip.wav: 4 channel(s), but microphone 4 of array 'circle4' is on channel 9"),
        (unknown_array, "array 'circle7' is neither a preset"),
    ],
)
def test_bad_input_gets_one_sentence_and_leaves_nothing(
    breakage: Callable[[Path, Path], list[str]],
    says: str,
    checkpoint: Path,
    clip: tuple[Path, Path],
    tmp_path: Path,
    refusal: Callable[[Callable[[], int | None]], str],
) -> None:
    words = [*breakage(*clip), "--overlay", str(tmp_path / "overlay.png"), "--separate", str(tmp_path / "sounds")]
    before = set(tmp_path.iterdir())
    assert says in refusal(lambda: main(arguments(checkpoint, *clip, tmp_path / "out.json", *words)))
    assert set(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("image\npano.png\n", "column 'audio' is missing"),
        ("audio,image\n", "holds nothing below its first line"),
        ("audio,image\n,pano.png\n", "line 2: column 'audio' is empty"),
        ("audio,image\nclip.wav,gone.png\n", "gone.png: no such image file"),
    ],
)
def test_a_bad_manifest_is_told_with_its_line(
    content: str,
    says: str,
    checkpoint: Path,
    clip: tuple[Path, Path],
    tmp_path: Path,
    refusal: Callable[[Callable[[], int | None]], str],
) -> None:
    manifest, out = tmp_path / "clips.csv", tmp_path / "out.jsonl"
    manifest.write_text(content)
    assert says in refusal(lambda: main(["--checkpoint", str(checkpoint), "--clips", str(manifest), "--out", str(out)]))
    assert not out.exists()


def test_every_source_gets_its_sound_in_a_file_that_the_result_names(
    checkpoint: Path, clip: tuple[Path, Path], tmp_path: Path
) -> None:
    out, folder = tmp_path / "result.json", tmp_path / "sounds"
    main(arguments(checkpoint, *clip, out, "--separate", str(folder), "--least-level", "0"))
    sources = json.loads(out.read_text())["sources"]
    assert sources
    assert {Path(source["separated"]) for source in sources} == set(folder.iterdir())
    heard, _ = soundfile.read(clip[1])
    for source in sources:
        assert f"clip-source{sources.index(source) + 1}-az{round(source['azimuth_deg']):+04d}" in source["separated"]
        sound, rate = soundfile.read(source["separated"])
        assert (sound.shape, rate) == ((16_000,), 16_000)
        assert 0 < np.mean(sound**2) < 2 * np.mean(heard[:, 0] ** 2)


def test_clips_of_a_manifest_keep_their_sounds_apart(checkpoint: Path, clip: tuple[Path, Path], tmp_path: Path) -> None:
    image, audio = clip
    manifest, out, folder = tmp_path / "clips.csv", tmp_path / "results.jsonl", tmp_path / "sounds"
    manifest.write_text(f"audio,image\n{audio.name},{image.name}\n{audio.name},{image.name}\n")
    words = ["--checkpoint", str(checkpoint), "--clips", str(manifest), "--out", str(out), "--least-level", "0"]
    main([*words, "--separate", str(folder)])
    lines = [json.loads(line) for line in out.read_text().splitlines()]
    named = [source["separated"] for line in lines for source in line["sources"]]
    assert len(named) == len(set(named))
    assert {Path(name) for name in named} == set(folder.iterdir())


def test_nothing_is_separated_of_a_silent_clip_or_unless_asked(
    checkpoint: Path, clip: tuple[Path, Path], tmp_path: Path
) -> None:
    main(arguments(checkpoint, *clip, tmp_path / "plain.json", "--least-level", "0"))
    assert "separated" not in json.loads((tmp_path / "plain.json").read_text())["sources"][0]
    soundfile.write(clip[1], np.zeros((16_000, 4)), 16_000)
    main(arguments(checkpoint, *clip, tmp_path / "silent.json", "--separate", str(tmp_path / "sounds")))
    assert not list((tmp_path / "sounds").iterdir())


def test_a_file_in_place_of_the_folder_and_a_whole_recording_are_refused(
    checkpoint: Path,
    clip: tuple[Path, Path],
    tmp_path: Path,
    refusal: Callable[[Callable[[], int | None]], str],
) -> None:
    image, audio = clip
    before = set(tmp_path.iterdir())
    words = arguments(checkpoint, image, audio, tmp_path / "out.json", "--separate", str(audio))
    assert "clip.wav: is a file; name a folder" in refusal(lambda: main(words))
    words = ["--checkpoint", str(checkpoint), "--video", str(image), "--audio", str(audio)]
    words += ["--out", str(tmp_path / "out.jsonl"), "--separate", str(tmp_path / "sounds")]
    assert "--separate is for single clips; leave it out, or leave out --video" in refusal(lambda: main(words))
    assert set(tmp_path.iterdir()) == before


def test_a_missing_checkpoint_is_told(
    clip: tuple[Path, Path], tmp_path: Path, refusal: Callable[[Callable[[], int | None]], str]
) -> None:
    words = arguments(tmp_path / "none.safetensors", *clip, tmp_path / "out.json")
    assert "none.safetensors: no such checkpoint" in refusal(lambda: main(words))


def test_a_full_disk_leaves_nothing_half_written(
    checkpoint: Path,
    clip: tuple[Path, Path],
    tmp_path: Path,
    request: pytest.FixtureRequest,
    refusal: Callable[[Callable[[], int | None]], str],
) -> None:
    before = set(tmp_path.iterdir())
    request.getfixturevalue("full_disk")
    words = arguments(checkpoint, *clip, tmp_path / "out.json")
    assert "out.json: no space is left on the disk" in refusal(lambda: main(words))
    assert set(tmp_path.iterdir()) == before


def test_a_silent_clip_holds_nobody_and_is_told(
    checkpoint: Path, clip: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image, audio = clip
    soundfile.write(audio, np.zeros((16_000, 4)), 16_000)
    main(arguments(checkpoint, image, audio, tmp_path / "out.json"))
    captured = capsys.readouterr()
    assert captured.err == f"warning: {audio}: is silent throughout.\n"
    assert captured.out == "no sounding object found.\n"
    assert json.loads((tmp_path / "out.json").read_text())["sources"] == []


def test_without_a_picture_one_json_object_goes_to_standard_output(
    checkpoint: Path, clip: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    main(["--checkpoint", str(checkpoint), "--audio", str(clip[1])])
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert printed.out.count("\n") == 1
    assert result["audio"] == str(clip[1])
    assert "image" not in result
    assert all(-180 <= source["azimuth_deg"] < 180 for source in result["sources"])
    assert "azimuth" in printed.err or "no sounding object" in printed.err


def test_audio_alone_finds_the_talkers_of_a_scene(scene_folder: Path, tmp_path: Path) -> None:
    dataset = SceneDataset(scene_folder, PRESETS["circle6"])
    audio, out = tmp_path / "clip.wav", tmp_path / "result.json"
    soundfile.write(audio, dataset[0].audio_mn.T, 16_000, subtype="FLOAT")
    main(["--audio", str(audio), "--array", "circle6", "--out", str(out)])
    found = [source["azimuth_deg"] for source in json.loads(out.read_text())["sources"]]
    for azimuth in np.rad2deg(dataset.labels(0).talker_azimuths):
        assert min(abs((one - azimuth + 180) % 360 - 180) for one in found) < 7.5


def test_a_list_may_leave_out_pictures_and_keeps_the_names_of_its_clips(
    checkpoint: Path, clip: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image, audio = clip
    listed = tmp_path / "clips.csv"
    listed.write_text(f"audio,image\n{audio.name},{image.name}\n{audio.name},\n")
    main(["--checkpoint", str(checkpoint), "--clips", str(listed)])
    seen, heard = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert seen["audio"] == heard["audio"] == "clip.wav"
    assert "image" in seen
    assert "image" not in heard
    listed.write_text(f"audio\n{audio.name}\n")
    main(["--checkpoint", str(checkpoint), "--clips", str(listed)])
    assert json.loads(capsys.readouterr().out)["sources"] == heard["sources"]
    main(["--checkpoint", str(checkpoint), "--audio", str(audio)])
    assert json.loads(capsys.readouterr().out)["sources"] == heard["sources"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--rounds", "0"], "without an image the posterior comes from refinement alone"),
        (["--least-level", "1.5"], "--least-level is 1.5; give a direct level from 0 to 1"),
        (["--yaw", "90"], "--yaw is for whole recordings"),
        (["--no-tracking"], "--no-tracking is for whole recordings"),
        (["--out", "clip.wav"], "clip.wav: is read or written by the same command already"),
    ],
)
def test_what_audio_alone_cannot_use_is_refused(
    words: list[str],
    says: str,
    checkpoint: Path,
    clip: tuple[Path, Path],
    monkeypatch: pytest.MonkeyPatch,
    refusal: Callable[[Callable[[], int | None]], str],
) -> None:
    monkeypatch.chdir(clip[1].parent)
    before = clip[1].read_bytes()
    assert says in refusal(lambda: main(["--checkpoint", str(checkpoint), "--audio", str(clip[1]), *words]))
    assert clip[1].read_bytes() == before

"""The front door: load, localize, simulate, train."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import soundfile

import avssl_pyro as av
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.io.images import save_png
from avssl_pyro.io.video_writer import open_video
from avssl_pyro.localization.direct_level import ONE_PASS_RULE
from avssl_pyro.systems.checkpoint import save_checkpoint
from avssl_pyro.systems.config import GuideConfig
from avssl_pyro.training.config import OptimizationConfig


@pytest.fixture(scope="module")
def model() -> av.Model:
    return av.load("circle4", rounds=5)


@pytest.fixture(scope="module")
def clip(scene_folder: Path) -> av.Clip:
    return SceneDataset(scene_folder, PRESETS["circle4"])[0]


@pytest.fixture(scope="module")
def files(clip: av.Clip, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("clip")
    audio, image = folder / "talk.wav", folder / "room.png"
    soundfile.write(audio, clip.audio_mn.T, 16_000, subtype="FLOAT")
    save_png(image, clip.image_ijc)
    return audio, image


def test_paths_and_arrays_give_the_same_result(model: av.Model, clip: av.Clip, files: tuple[Path, Path]) -> None:
    audio, image = files
    from_files = model.localize(audio, image)
    from_arrays = model.localize(clip.audio_mn.astype(np.float64), clip.image_ijc)
    assert from_files.sources == from_arrays.sources == model.localize(str(audio), str(image)).sources
    assert from_files.sources
    np.testing.assert_array_equal(from_files.posterior.direction_weights_kd, from_arrays.posterior.direction_weights_kd)


def test_the_result_is_the_documented_one(model: av.Model, clip: av.Clip, files: tuple[Path, Path]) -> None:
    audio, image = files
    content = json.loads(json.dumps(model.localize(audio, image).to_dict(), allow_nan=False))
    assert list(content) == [
        *("format", "audio", "image", "array", "checkpoint"),
        *("sources", "mixing_levels", "direction_weights", "diffuse_shares", "directions_deg"),
    ]
    assert (content["format"], content["audio"], content["image"]) == ("avssl-result/1", str(audio), str(image))
    assert (content["array"]["name"], content["checkpoint"]) == ("circle4", "shipped")
    assert {"audio", "image"}.isdisjoint(model.localize(clip.audio_mn, clip.image_ijc).to_dict())


def test_degrees_are_those_of_the_radians(model: av.Model, files: tuple[Path, Path]) -> None:
    result = model.localize(*files)
    for source, row in zip(result.sources, result.to_dict()["sources"], strict=True):
        assert source.azimuth_deg == pytest.approx(np.rad2deg(source.azimuth))
        assert source.azimuth_std_deg == pytest.approx(np.rad2deg(source.azimuth_std))
        assert row["azimuth_deg"] == pytest.approx(source.azimuth_deg, abs=0.006)


def test_without_an_image_the_audio_alone_decides(files: tuple[Path, Path]) -> None:
    model = av.load("circle4")
    result = model.localize(files[0])
    assert result.sources
    assert "image" not in result.to_dict()
    drawing = result.plot()
    assert drawing.dtype == np.uint8
    assert drawing.shape[-1] == 3


def test_another_sample_rate_is_resampled(model: av.Model, clip: av.Clip) -> None:
    twice = np.repeat(clip.audio_mn, 2, axis=1)
    result = model.localize(twice, clip.image_ijc, sample_rate=32_000)
    assert result.clip.audio_mn.shape == clip.audio_mn.shape


def test_a_full_sphere_is_cropped(model: av.Model, clip: av.Clip) -> None:
    sphere = np.random.default_rng(0).integers(0, 256, (288, 576, 3)).astype(np.uint8)
    assert model.localize(clip.audio_mn, sphere).clip.image_ijc.shape == (88, 288, 3)


def test_a_plot_is_returned_and_written(model: av.Model, files: tuple[Path, Path], tmp_path: Path) -> None:
    result = model.localize(*files)
    drawing = result.plot(tmp_path / "overlay.png")
    written = cv2.imread(str(tmp_path / "overlay.png"), cv2.IMREAD_COLOR_RGB)
    np.testing.assert_array_equal(drawing, written)


def test_sounds_are_one_a_source(model: av.Model, files: tuple[Path, Path], tmp_path: Path) -> None:
    result = model.localize(*files)
    sound_sn = result.separate()
    assert sound_sn.shape == (len(result.sources), 16_000)
    paths = result.save_sounds(tmp_path)
    for sound_n, path in zip(sound_sn, paths, strict=True):
        np.testing.assert_array_equal(soundfile.read(path, dtype="float32")[0], sound_n)
    assert [row["separated"] for row in result.to_dict(paths)["sources"]] == [str(path) for path in paths]


def test_a_model_is_a_preset_an_array_file_an_array_or_a_checkpoint(model: av.Model, tmp_path: Path) -> None:
    PRESETS["respeaker4"].save(tmp_path / "mine.yaml")
    assert av.load(tmp_path / "mine.yaml").array == av.load(PRESETS["respeaker4"]).array
    path = tmp_path / "own.safetensors"
    save_checkpoint(path, model.system)
    own = av.load(path)
    assert repr(own) == f"Model(array='circle4', weights='{path}')"
    # The same microphones on other channels.
    crossed = replace(PRESETS["circle4"], channels=(4, 3, 2, 1))
    assert av.load(path, array=crossed).array.channel_indices == (3, 2, 1, 0)
    with pytest.raises(av.InputError, match="trained for array 'circle4' with 4 microphones, but 'circle6' has 6"):
        av.load(path, array="circle6")


def test_one_rule_decides_for_all_starts(model: av.Model, clip: av.Clip) -> None:
    one_pass = av.load("circle4", rounds=0)
    assert model.localizer.rule == model.audio_only_localizer.rule == av.DirectLevelRule()
    assert one_pass.localizer.rule == ONE_PASS_RULE
    strict = av.load("circle4", rounds=5, rule=av.DirectLevelRule(least=1.0))
    assert strict.localize(clip.audio_mn, clip.image_ijc).sources == ()
    with pytest.raises(av.InputError, match="without an image the posterior comes from refinement alone"):
        one_pass.localize(clip.audio_mn)


AUDIO = np.zeros((4, 16_000))


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda _: av.load("circle7"), "array 'circle7' is neither a preset .circle2, .* nor a YAML file"),
        (lambda _: av.load("nowhere.safetensors"), "nowhere.safetensors: no such checkpoint"),
        (lambda _: av.load("circle4", array="circle4"), "leave out 'array'"),
        (lambda _: av.load("circle4", rounds=-1), "rounds is -1"),
        (lambda _: av.load("circle4", device="nonsense"), "device 'nonsense' cannot be used here"),
        (lambda model: model.localize("nowhere.wav"), "nowhere.wav: no such audio file"),
        (lambda model: model.localize(AUDIO, "nowhere.png"), "nowhere.png: no such image file"),
        (lambda model: model.localize(AUDIO[0]), r"its shape is \(16000,\); give \(M, N\)"),
        (lambda model: model.localize(AUDIO.T), r"its shape is \(16000, 4\); give \(M, N\).*transpose"),
        (lambda model: model.localize(AUDIO[:3]), "3 channel.* but array 'circle4' has 4 microphones"),
        (lambda model: model.localize(AUDIO.astype(np.int16)), "its type is int16; give floats"),
        (lambda model: model.localize(np.full_like(AUDIO, np.nan)), "audio: .*not finite|audio: .*finite"),
        (lambda model: model.localize(AUDIO[:, :100]), "audio: 100 samples"),
        (lambda model: model.localize(AUDIO, sample_rate=0), "sample_rate is 0"),
        (lambda model: model.localize(AUDIO, sample_rate="8k"), "sample_rate is 8k"),
        (lambda model: model.localize("a.wav", sample_rate=8000), "leave out 'sample_rate'"),
        (lambda model: model.localize(AUDIO, np.zeros((88, 288), np.uint8)), r"its shape is \(88, 288\); give RGB"),
        (lambda model: model.localize(AUDIO, np.zeros((88, 288, 3))), "its type is float64; give uint8"),
        (lambda model: model.localize(AUDIO, np.zeros((90, 90, 3), np.uint8)), "image: 90 x 90 pixels"),
        (lambda model: model.localize(AUDIO).plot("overlay.jpg"), "overlay.jpg: pictures are written as PNG"),
        (lambda _: av.simulate("nowhere", 0), "scenes is 0"),
        (lambda _: av.simulate("nowhere", condition="quiet"), "condition is 'quiet'; give one of all-speak"),
        (lambda _: av.simulate("nowhere", workers=0), "workers is 0; give at least 1"),
        (lambda _: av.train("fast"), "preset is 'fast'; give one of quick"),
        (lambda _: av.train(epochs=3), "there is no setting 'epochs'; the settings are preset"),
    ],
)
def test_bad_input_gets_one_sentence(model: av.Model, call: Callable[[av.Model], object], says: str) -> None:
    with pytest.raises(av.InputError, match=says) as caught:
        call(model)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


def test_a_recording_is_localized_with_and_without_its_video(model: av.Model, clip: av.Clip, tmp_path: Path) -> None:
    audio, video = tmp_path / "walk.wav", tmp_path / "walk.mp4"
    soundfile.write(audio, np.tile(clip.audio_mn, 2).T, 16_000, subtype="FLOAT")
    with open_video(video, 576, 288, 10.0) as out:
        for index in range(20):
            out.write(np.full((288, 576, 3), 120, np.uint8), index / 10.0)
    timeline = model.localize_recording(audio, video)
    assert [frame.time_s for frame in timeline.frames] == [0.5, 1.0, 1.5]
    by_audio = av.load("circle4").localize_recording(audio, rate_hz=1.0, tracking=False)
    assert [frame.time_s for frame in by_audio.frames] == [0.5, 1.5]
    # Both windows are the same clip.
    expected = [source.azimuth_deg for source in av.load("circle4").localize(clip.audio_mn).sources]
    for frame in by_audio.frames:
        assert [source.azimuth_deg for source in frame.sources] == pytest.approx(expected, abs=0.01)


def test_scenes_are_simulated_and_trained_on(tmp_path: Path) -> None:
    scenes = av.simulate(tmp_path / "scenes", 4, array="circle2", workers=1)
    assert len(scenes) == 4
    assert scenes[0].audio_mn.shape == (2, 16_000)
    model = av.train(
        "quick",
        data=tmp_path / "scenes",
        array="circle2",
        out=tmp_path / "run",
        guide=GuideConfig(visual_channels=(4, 8), audio_channels=4),
        optimization=OptimizationConfig(epochs=1, batch_size=4, num_workers=0),
    )
    assert model.array.name == "circle2"
    assert model.weights == str(tmp_path / "run" / "checkpoint.safetensors")
    assert (tmp_path / "run" / "curves.png").is_file()

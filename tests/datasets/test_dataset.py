import hashlib
import json
import os
import pickle
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS, uniform_circle
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.generation import GenerationPlan
from avssl_pyro.errors import InputError

MakeScenes = Callable[..., GenerationPlan]


def alter(shard: Path) -> None:
    """Flips one bit, leaving size and time as they are."""
    times = shard.stat()
    content = bytearray(shard.read_bytes())
    content[700] ^= 1
    shard.write_bytes(content)
    os.utime(shard, ns=(times.st_atime_ns, times.st_mtime_ns))


def test_scenes_come_back_as_they_were_rendered(make_scenes: MakeScenes) -> None:
    plan = make_scenes()
    dataset = SceneDataset(plan.folder)
    assert len(dataset) == 10
    assert dataset.array == PRESETS["circle246"]
    for index in range(10):
        scene, clip = plan.simulator.render(index), dataset[index]
        assert clip.key == scene.clip.key
        np.testing.assert_allclose(clip.audio_mn, scene.clip.audio_mn, atol=1 / 65536 + 1e-7)
        assert np.abs(clip.image_ijc.astype(int) - scene.clip.image_ijc.astype(int)).max() <= 8
        assert dataset.labels(index).talker_azimuths == pytest.approx(scene.labels.talker_azimuths)
        assert dataset.labels(index).silent_azimuths == pytest.approx(scene.labels.silent_azimuths)
        assert dataset.metadata(index) == scene.metadata
    assert dataset[-1].key == dataset[9].key
    for beyond in (10, -11):
        with pytest.raises(IndexError):
            dataset[beyond]


def test_the_fingerprint_knows_scenes_and_not_their_place(make_scenes: MakeScenes, tmp_path: Path) -> None:
    folder = make_scenes().folder
    copy = shutil.copytree(folder, tmp_path / "copy")
    fingerprint = SceneDataset(folder, PRESETS["circle2"]).fingerprint
    assert SceneDataset(copy, PRESETS["circle6"]).fingerprint == fingerprint
    assert SceneDataset([folder, copy]).fingerprint != fingerprint
    manifest = json.loads((copy / "manifest.json").read_text())
    manifest["shards"][0]["sha256"] = "0" * 64
    (copy / "manifest.json").write_text(json.dumps(manifest))
    assert SceneDataset(copy).fingerprint != fingerprint


@pytest.mark.parametrize(
    ("array", "channels"), [("circle2", [0, 4]), ("circle4", [0, 2, 4, 6]), ("circle6", [0, 1, 3, 4, 5, 7])]
)
def test_one_rendering_is_read_as_any_of_the_papers_arrays(
    make_scenes: MakeScenes, array: str, channels: list[int]
) -> None:
    folder = make_scenes().folder
    dataset = SceneDataset(folder, PRESETS[array])
    assert dataset.array == PRESETS[array]
    whole_mn = SceneDataset(folder)[3].audio_mn
    np.testing.assert_array_equal(dataset[3].audio_mn, whole_mn[channels])
    np.testing.assert_array_equal(SceneDataset(folder, channels=channels)[3].audio_mn, whole_mn[channels])


def test_microphones_are_matched_by_place_not_by_number(make_scenes: MakeScenes) -> None:
    folder = make_scenes().folder
    turned = PRESETS["circle246"].select((5, 0, 2), name="turned")
    moved = MicrophoneArray("turned", tuple((x + 9e-5, y, z) for x, y, z in turned.positions_m))
    audio_mn = SceneDataset(folder, moved)[0].audio_mn
    assert audio_mn.mean(axis=1) == pytest.approx([6 / 50, 1 / 50, 3 / 50], abs=0.002)


def test_a_microphone_that_was_not_rendered_is_named(make_scenes: MakeScenes) -> None:
    folder = make_scenes().folder
    with pytest.raises(InputError, match=r"'circle246'.*no microphone at.*'circle5' has its microphone 2"):
        SceneDataset(folder, uniform_circle(5))
    with pytest.raises(InputError, match="channel 8 does not exist"):
        SceneDataset(folder, channels=[0, 8])
    with pytest.raises(InputError, match="not both"):
        SceneDataset(folder, PRESETS["circle2"], channels=[0, 4])


def test_folders_are_joined_and_read_as_one_array(make_scenes: MakeScenes) -> None:
    first = make_scenes("first", 6).folder
    second = make_scenes("second", 5, seed=1, array=PRESETS["circle6"]).folder
    joined = SceneDataset([first, second], PRESETS["circle2"])
    assert joined.shard_sizes == (4, 2, 4, 1)
    assert [joined[index].key for index in (5, 6, 10)] == ["fake-0-000005", "fake-1-000000", "fake-1-000004"]
    assert joined[0].audio_mn.mean(axis=1) == pytest.approx([1 / 50, 5 / 50], abs=0.002)
    assert joined[6].audio_mn.mean(axis=1) == pytest.approx([1 / 50, 4 / 50], abs=0.002)
    with pytest.raises(InputError, match=r"second.*no microphone"):
        SceneDataset([first, second])
    with pytest.raises(InputError, match="no folder"):
        SceneDataset([])


def test_many_microphones_are_read_from_wav(make_scenes: MakeScenes) -> None:
    plan = make_scenes(num_scenes=2, array=uniform_circle(16))
    assert SceneDataset(plan.folder)[1].audio_mn.mean(axis=1) == pytest.approx(np.arange(1, 17) / 50, abs=0.002)


def test_a_truncated_or_missing_shard_is_named_at_once(make_scenes: MakeScenes) -> None:
    folder = make_scenes().folder
    shard = folder / "scenes-000001.tar"
    shard.write_bytes(shard.read_bytes()[:-10])
    with pytest.raises(InputError, match=r"scenes-000001\.tar is truncated"):
        SceneDataset(folder)
    shard.unlink()
    with pytest.raises(InputError, match=r"scenes-000001\.tar is missing"):
        SceneDataset(folder)


@pytest.mark.parametrize("read", [SceneDataset.__getitem__, SceneDataset.labels, SceneDataset.metadata])
def test_an_altered_shard_is_named_before_anything_of_it_is_used(
    make_scenes: MakeScenes, read: Callable[[SceneDataset, int], object]
) -> None:
    folder = make_scenes().folder
    alter(folder / "scenes-000001.tar")
    dataset = SceneDataset(folder)
    read(dataset, 0)
    for index in (4, 7, 4):
        with pytest.raises(InputError, match=r"scenes-000001\.tar is altered"):
            read(dataset, index)


def test_an_altered_shard_is_found_by_each_copy_of_the_dataset(make_scenes: MakeScenes) -> None:
    folder = make_scenes().folder
    dataset = SceneDataset(folder)
    assert dataset[4].key == "fake-0-000004"
    alter(folder / "scenes-000001.tar")
    with pytest.raises(InputError, match=r"scenes-000001\.tar is altered"):
        pickle.loads(pickle.dumps(dataset))[4]


def test_more_shards_than_may_be_open_at_once(make_scenes: MakeScenes) -> None:
    plan = make_scenes(num_scenes=300, num_samples=16)
    dataset = SceneDataset(plan.folder)
    open_before = len(list(Path("/proc/self/fd").iterdir())) if Path("/proc/self/fd").exists() else 0
    assert [dataset[index].key for index in range(0, 300, 4)] == [f"fake-0-{index:06d}" for index in range(0, 300, 4)]
    assert dataset[0].key == "fake-0-000000"
    if open_before:
        assert len(list(Path("/proc/self/fd").iterdir())) <= open_before + 65


def test_a_clip_is_read_without_its_labels(make_scenes: MakeScenes, tmp_path: Path) -> None:
    """Even with every JSON file gone from the shards, clips are read; so they cannot depend on labels."""
    folder = make_scenes(num_scenes=4).folder
    bare = tmp_path / "bare"
    shutil.copytree(folder, bare)
    with tarfile.open(folder / "scenes-000000.tar") as source, tarfile.open(bare / "scenes-000000.tar", "w") as target:
        for member in source.getmembers():
            if not member.name.endswith(".json"):
                target.addfile(member, source.extractfile(member))
    forge_manifest(bare)
    dataset = SceneDataset(bare)
    assert dataset[3].key == "fake-0-000003"
    with pytest.raises(InputError, match=r"'fake-0-000003'.*no \.json"):
        dataset.labels(3)


def forge_manifest(folder: Path) -> None:
    """Makes the manifest of a one-shard dataset agree with its altered shard."""
    content = (folder / "scenes-000000.tar").read_bytes()
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["shards"][0] |= {"num_bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    path.write_text(json.dumps(manifest))


def test_a_rendering_for_another_array_than_the_manifest_says_is_refused(make_scenes: MakeScenes) -> None:
    folder = make_scenes(num_scenes=4, array=PRESETS["circle4"]).folder
    path = folder / "manifest.json"
    other = make_scenes("other", num_scenes=4).folder / "manifest.json"
    array = SceneDataset(other.parent).array
    path.write_text(json.dumps(json.loads(path.read_text()) | {"array": array.to_dict()}))
    with pytest.raises(InputError, match="has 4 channels; the manifest's array has 8"):
        SceneDataset(folder)[0]


def test_shards_are_read_where_the_system_has_no_pread(
    make_scenes: MakeScenes, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_scenes().folder
    expected = SceneDataset(folder)[1]
    monkeypatch.delattr(os, "pread")
    np.testing.assert_array_equal(SceneDataset(folder)[1].audio_mn, expected.audio_mn)

import dataclasses
from collections.abc import Callable

import pytest
import torch

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.batch import ClipBatch
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.generation import GenerationPlan
from avssl_pyro.datasets.loader import make_loader
from avssl_pyro.datasets.sampling import WindowShuffleSampler
from avssl_pyro.errors import InputError

MakeScenes = Callable[..., GenerationPlan]


def assert_equal(first: ClipBatch, second: ClipBatch) -> None:
    assert first.keys == second.keys
    assert torch.equal(first.audio_bmn, second.audio_bmn)
    assert torch.equal(first.image_bcij, second.image_bcij)


@pytest.mark.parametrize(("num_workers", "start_method"), [(1, "forkserver"), (2, "spawn")])
def test_workers_change_neither_batches_nor_their_order(
    make_scenes: MakeScenes, num_workers: int, start_method: str
) -> None:
    dataset = SceneDataset(make_scenes(num_scenes=13).folder, PRESETS["circle6"])
    # Read before the workers start, as training code may do: open files must not be shared with them.
    assert dataset[0].audio_mn.shape == (6, 320)
    sampler = WindowShuffleSampler(dataset.shard_sizes, 3, seed=1, drop_last=False)
    alone = list(make_loader(dataset, sampler))
    helped = list(make_loader(dataset, sampler, num_workers, start_method=start_method))
    for first, second in zip(alone, helped, strict=True):
        assert_equal(first, second)
    assert [len(batch) for batch in alone] == [3, 3, 3, 3, 1]


def test_batches_hold_what_the_clips_hold_and_no_labels(make_scenes: MakeScenes) -> None:
    dataset = SceneDataset(make_scenes().folder, PRESETS["circle4"])
    (batch,) = make_loader(dataset, [[7, 2]])
    assert {field.name for field in dataclasses.fields(batch)} == {"keys", "audio_bmn", "image_bcij"}
    assert batch.keys == (dataset[7].key, dataset[2].key)
    assert batch.audio_bmn.shape == (2, 4, 320)
    assert batch.audio_bmn.dtype == torch.float32
    assert torch.equal(batch.audio_bmn[1], torch.from_numpy(dataset[2].audio_mn))
    assert batch.image_bcij.shape == (2, 3, 88, 288)
    image_cij = torch.from_numpy(dataset[7].image_ijc.transpose(2, 0, 1).copy())
    assert torch.equal(batch.image_bcij[0], image_cij)
    moved = batch.to("cpu")
    assert_equal(batch, moved)
    torch.testing.assert_close(moved.image_float()[0], image_cij.float() / 255)


def test_a_resumed_loader_yields_the_rest(make_scenes: MakeScenes) -> None:
    dataset = SceneDataset(make_scenes(num_scenes=12).folder)
    sampler = WindowShuffleSampler(dataset.shard_sizes, 2, epoch=3)
    whole = list(make_loader(dataset, sampler))
    rest = list(make_loader(dataset, sampler.at(3, 4)))
    for first, second in zip(whole[4:], rest, strict=True):
        assert_equal(first, second)


@pytest.mark.parametrize("num_workers", [0, 1])
def test_an_altered_shard_stops_training_and_is_named(make_scenes: MakeScenes, num_workers: int) -> None:
    folder = make_scenes().folder
    shard = folder / "scenes-000001.tar"
    content = bytearray(shard.read_bytes())
    content[-2000] ^= 1
    shard.write_bytes(content)
    dataset = SceneDataset(folder)
    with pytest.raises(InputError, match=r"scenes-000001\.tar is altered"):
        list(make_loader(dataset, WindowShuffleSampler(dataset.shard_sizes, 2), num_workers))

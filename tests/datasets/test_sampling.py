import dataclasses
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.batch import ClipBatch
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.generation import GenerationPlan
from avssl_pyro.datasets.sampling import WindowShuffleSampler, make_loader
from avssl_pyro.errors import InputError

shard_sizes = st.lists(st.integers(1, 12), min_size=1, max_size=12).map(tuple)
seeds = st.integers(0, 2**31)
windows = st.integers(1, 5)


@given(shard_sizes, st.integers(1, 9), seeds, st.integers(0, 5), windows)
def test_every_clip_is_read_once_an_epoch(
    sizes: tuple[int, ...], batch_size: int, seed: int, epoch: int, window: int
) -> None:
    sampler = WindowShuffleSampler(sizes, batch_size, seed, epoch, window_shards=window, drop_last=False)
    batches = list(sampler)
    assert sorted(index for batch in batches for index in batch) == list(range(sum(sizes)))
    assert len(batches) == len(sampler)
    assert {len(batch) for batch in batches[:-1]} <= {batch_size}
    if sum(sizes) >= batch_size:
        assert list(replace(sampler, drop_last=True)) == [batch for batch in batches if len(batch) == batch_size]


@given(shard_sizes, st.integers(1, 4), st.integers(1, 4), seeds, windows)
def test_replicas_together_see_the_batches_of_one_process(
    sizes: tuple[int, ...], batch_size: int, replicas: int, seed: int, window: int
) -> None:
    if sum(sizes) < batch_size * replicas:
        return
    single = WindowShuffleSampler(sizes, batch_size * replicas, seed, window_shards=window)
    ranks = [
        WindowShuffleSampler(sizes, batch_size, seed, window_shards=window, num_replicas=replicas, rank=rank)
        for rank in range(replicas)
    ]
    joined = [[index for part in parts for index in part] for parts in zip(*ranks, strict=True)]
    assert joined == list(single)


@given(shard_sizes, st.integers(1, 4), st.integers(0, 3), windows, st.data())
def test_a_resumed_epoch_is_the_rest_of_the_whole_one(
    sizes: tuple[int, ...], batch_size: int, epoch: int, window: int, data: st.DataObject
) -> None:
    if sum(sizes) < batch_size:
        return
    sampler = WindowShuffleSampler(sizes, batch_size, seed=3, window_shards=window)
    step = data.draw(st.integers(0, sampler.steps_per_epoch))
    resumed = sampler.at(epoch, step)
    assert list(resumed) == list(sampler.at(epoch))[step:]
    assert len(resumed) == sampler.steps_per_epoch - step


@given(st.lists(st.integers(1, 12), min_size=4, max_size=12).map(tuple), seeds, windows)
def test_reading_stays_within_a_window_of_shards(sizes: tuple[int, ...], seed: int, window: int) -> None:
    order = [batch[0] for batch in WindowShuffleSampler(sizes, 1, seed, window_shards=window)]
    shard_of = np.repeat(np.arange(len(sizes)), sizes)
    done: set[int] = set()
    left = Counter({shard: size for shard, size in enumerate(sizes)})
    opened: set[int] = set()
    for index in order:
        shard = int(shard_of[index])
        assert shard not in done
        opened.add(shard)
        left[shard] -= 1
        if left[shard] == 0:
            done.add(shard)
        assert len(opened - done) <= window


def test_orders_differ_between_epochs_and_seeds_and_stay_in_place_when_asked() -> None:
    sampler = WindowShuffleSampler((50,) * 10, 10)
    assert list(sampler) == list(sampler)
    assert list(sampler) != list(sampler.at(1))
    assert list(sampler) != list(replace(sampler, seed=1))
    ordered = replace(sampler, shuffle=False)
    assert [index for batch in ordered for index in batch] == list(range(500))


def test_batches_mix_shards() -> None:
    batches = list(WindowShuffleSampler((100,) * 16, 32, window_shards=8))
    shards_per_batch = [len({index // 100 for index in batch}) for batch in batches]
    assert min(shards_per_batch) >= 4


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"batch_size": 0}, "batch_size is 0"),
        ({"epoch": -1}, "epoch is -1"),
        ({"num_replicas": 2, "rank": 2}, "rank 2 does not exist"),
        ({"batch_size": 11}, "10 clips do not fill one batch of 11"),
        ({"batch_size": 6, "num_replicas": 2}, "do not fill one batch of 12"),
        ({"num_replicas": 2, "drop_last": False}, "single replica"),
        ({"start_step": 6}, "step 6 is not in an epoch of 5"),
        ({"shard_sizes": ()}, "0 clips"),
    ],
)
def test_impossible_settings_are_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        replace(WindowShuffleSampler((5, 5), 2), **changes)  # type: ignore[arg-type]


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

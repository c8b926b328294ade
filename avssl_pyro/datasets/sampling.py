"""Order and batches of training: shuffled within windows, read almost sequentially, exactly resumable."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset

from avssl_pyro.batch import ClipBatch, collate_clips
from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.validators import at_least


@dataclass(frozen=True)
class WindowShuffleSampler:
    """Batches of clip indices for one epoch, a pure function of the fields below.

    Shards are permuted, and then the scenes inside each window of a few shards. Reading is random inside a window,
    which should fit the file cache, and sequential otherwise.

    The order depends on ``seed`` and ``epoch`` only. It is cut into global batches of ``batch_size * num_replicas``
    clips, of which each replica takes ``batch_size`` consecutive ones. R replicas thus read in step s the same clips as
    one process with R times the batch size.

    Args:
        shard_sizes: scenes per shard, see :attr:`SceneDataset.shard_sizes`.
        batch_size: clips per replica and step.
        seed: seed of the order.
        epoch: number of the epoch, counted from 0.
        start_step: number of batches at the start of the epoch that are skipped without being read.
        window_shards: shards per window.
        num_replicas: number of training processes.
        rank: number of this process, counted from 0.
        drop_last: True leaves out the last, incomplete global batch. It must be True with several replicas, whose last
            batches would differ in size.
        shuffle: False keeps the order, for evaluation.

    Raises:
        InputError: a number is out of range, or the clips do not fill one batch.
    """

    shard_sizes: tuple[int, ...]
    batch_size: int
    seed: int = 0
    epoch: int = 0
    start_step: int = 0
    window_shards: int = 8
    num_replicas: int = 1
    rank: int = 0
    drop_last: bool = True
    shuffle: bool = True

    def __post_init__(self) -> None:
        at_least(1).check(self, "batch_size", "window_shards", "num_replicas")
        at_least(0).check(self, "epoch", "seed")
        if not 0 <= self.rank < self.num_replicas:
            raise InputError(
                f"rank {self.rank} does not exist among {self.num_replicas} replicas, which are counted from 0."
            )
        if not self.drop_last and self.num_replicas > 1:
            raise InputError("drop_last=False needs a single replica: several would get unequal last batches.")
        if self.steps_per_epoch == 0:
            raise InputError(
                f"{self.num_clips} clips do not fill one batch of {self.global_batch_size}; use more scenes or a "
                "smaller batch."
            )
        if not 0 <= self.start_step <= self.steps_per_epoch:
            raise InputError(f"step {self.start_step} is not in an epoch of {self.steps_per_epoch} steps.")

    @property
    def num_clips(self) -> int:
        return sum(self.shard_sizes)

    @property
    def global_batch_size(self) -> int:
        return self.batch_size * self.num_replicas

    @property
    def steps_per_epoch(self) -> int:
        full, rest = divmod(self.num_clips, self.global_batch_size)
        return full + (rest > 0 and not self.drop_last)

    def at(self, epoch: int, start_step: int = 0) -> "WindowShuffleSampler":
        """Returns the sampler at another epoch and step, as in a resumed run."""
        return replace(self, epoch=epoch, start_step=start_step)

    def __len__(self) -> int:
        return self.steps_per_epoch - self.start_step

    def __iter__(self) -> Iterator[list[int]]:
        waiting: list[int] = []
        skip = self.start_step * self.global_batch_size
        steps_left = len(self)
        for window in self._windows():
            size = sum(self.shard_sizes[shard] for shard in window)
            if skip >= size:
                skip -= size
                continue
            waiting += self._order(window)[skip:]
            skip = 0
            while steps_left and len(waiting) >= self.global_batch_size:
                batch, waiting = waiting[: self.global_batch_size], waiting[self.global_batch_size :]
                steps_left -= 1
                yield batch[self.rank * self.batch_size : (self.rank + 1) * self.batch_size]
        if steps_left and waiting:
            yield waiting

    def _windows(self) -> list[list[int]]:
        shards = np.arange(len(self.shard_sizes))
        if self.shuffle:
            np.random.default_rng((self.seed, self.epoch)).shuffle(shards)
        order = [int(shard) for shard in shards]
        return [order[first : first + self.window_shards] for first in range(0, len(order), self.window_shards)]

    def _order(self, window: list[int]) -> list[int]:
        firsts = np.concatenate([[0], np.cumsum(self.shard_sizes)])
        indices = np.concatenate([np.arange(firsts[shard], firsts[shard + 1]) for shard in window])
        if self.shuffle:
            # The seed contains the window's first shard, so that windows before a resumed step need not be drawn.
            np.random.default_rng((self.seed, self.epoch, 1 + window[0])).shuffle(indices)
        return [int(index) for index in indices]


def make_loader(
    dataset: Dataset[Clip],
    batch_sampler: Iterable[list[int]],
    num_workers: int = 0,
    device: torch.device | str = "cpu",
    start_method: str = "spawn",
) -> DataLoader[ClipBatch]:
    """Returns a loader of batches in the order of ``batch_sampler``, alike for any number of workers.

    Args:
        dataset: clips, for example a :class:`SceneDataset`.
        batch_sampler: indices of each batch, for example a :class:`WindowShuffleSampler`.
        num_workers: number of processes that read ahead; 0 reads in this process.
        device: later device of the batches; memory is page-locked for any but the CPU. ``batch.to`` moves a batch.
        start_method: start method of the workers, "spawn" or "forkserver". A forked worker waits forever for OpenCV's
            threads if its parent had some.
    """
    # In torch's stubs a loader yields items of the dataset; this one yields batches.
    items: Dataset[Any] = dataset
    return DataLoader(
        items,
        batch_sampler=batch_sampler,
        num_workers=num_workers,
        collate_fn=collate_clips,
        pin_memory=torch.device(device).type != "cpu",
        worker_init_fn=_start_worker,
        multiprocessing_context=start_method if num_workers else None,
        prefetch_factor=4 if num_workers else None,
    )


def _start_worker(_worker: int) -> None:
    cv2.setNumThreads(1)

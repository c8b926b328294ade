"""The order in which clips are trained on: shuffled well enough, read almost in sequence, and resumed exactly."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class WindowShuffleSampler:
    """Batches of indices for one epoch, a pure function of the fields below.

    Shards are permuted; then the scenes inside each window of a few shards are. A window is what is read at random, so
    it should fit the file cache; everything else is sequential.

    The order depends on ``seed`` and ``epoch`` alone. It is cut into global batches of ``batch_size * num_replicas``,
    of which replica ``rank`` takes its ``batch_size`` in a row: R replicas together see in step s just what one process
    with R times the batch size sees.

    Args:
        shard_sizes: scenes per shard, as of :attr:`SceneDataset.shard_sizes`.
        batch_size: clips per replica and step.
        seed: of the order.
        epoch: counted from 0.
        start_step: skip so many batches of the epoch without computing or reading them.
        window_shards: shards per window.
        num_replicas: training processes.
        rank: this process, from 0.
        drop_last: leave out the last, incomplete global batch. It can be kept with one replica only, for several would
            disagree about their gradients' weight.
        shuffle: False reads in order, for evaluation.

    Raises:
        InputError: a number is out of range, or there are too few clips for one batch.
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
        for name, least in (("batch_size", 1), ("epoch", 0), ("window_shards", 1), ("num_replicas", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise InputError(f"{name} is {getattr(self, name)}; it must be at least {least}.")
        if not 0 <= self.rank < self.num_replicas:
            raise InputError(f"rank {self.rank} does not exist among {self.num_replicas} replicas, which count from 0.")
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
        """The same sampler at another place, as in a resumed run."""
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
            # Keyed by the window's first shard, so that windows before a resumed step need not be drawn.
            np.random.default_rng((self.seed, self.epoch, 1 + window[0])).shuffle(indices)
        return [int(index) for index in indices]

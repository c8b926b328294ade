"""From a dataset and an order to batches, in this process or in worker processes."""

from collections.abc import Iterable
from typing import Any

import cv2
import torch
from torch.utils.data import DataLoader, Dataset

from avssl_pyro.batch import ClipBatch, collate_clips
from avssl_pyro.clip import Clip


def make_loader(
    dataset: Dataset[Clip],
    batch_sampler: Iterable[list[int]],
    num_workers: int = 0,
    device: torch.device | str = "cpu",
    start_method: str = "spawn",
) -> DataLoader[ClipBatch]:
    """Batches of ``dataset`` in the order of ``batch_sampler``, the same ones whatever the number of workers.

    Args:
        dataset: for example a :class:`SceneDataset`.
        batch_sampler: for example a :class:`WindowShuffleSampler`.
        num_workers: processes that read ahead; 0 reads when asked.
        device: where the batches will go; anything but the CPU has them page-locked. Move them with ``batch.to``.
        start_method: of the workers: "spawn" or "forkserver". A forked worker waits forever for OpenCV's threads if
            the process that forked it had some.
    """
    # torch's stubs know only loaders that yield what the dataset holds; this one collates clips to batches.
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

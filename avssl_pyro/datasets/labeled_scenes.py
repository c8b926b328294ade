"""A data set with its labels, for evaluation."""

from collections.abc import Iterator, Sequence
from typing import Any

from avssl_pyro.clip import Clip, SceneLabels
from avssl_pyro.datasets.dataset import SceneDataset


class LabeledScenes(Sequence[tuple[Clip, SceneLabels]]):
    """Clips and labels, read as they are walked through."""

    def __init__(self, dataset: SceneDataset) -> None:
        self._dataset = dataset

    @property
    def fingerprint(self) -> str:
        """As of :attr:`SceneDataset.fingerprint`."""
        return self._dataset.fingerprint

    def __len__(self) -> int:
        return len(self._dataset)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return self._dataset[index], self._dataset.labels(index)

    def __iter__(self) -> Iterator[tuple[Clip, SceneLabels]]:
        for index in range(len(self)):
            yield self._dataset[index], self._dataset.labels(index)

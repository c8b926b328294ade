"""Map-style dataset of the clips of one or more folders, for the rendered array or a sub-array of it."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from torch.utils.data import Dataset

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.compatibility import matching_channels
from avssl_pyro.clip import Clip, SceneLabels
from avssl_pyro.datasets.encoding import (
    AUDIO_EXTENSIONS,
    FLAC_MAX_CHANNELS,
    IMAGE_EXTENSION,
    METADATA_EXTENSION,
    decode_audio,
    decode_image,
    decode_metadata,
)
from avssl_pyro.datasets.manifest import to_json
from avssl_pyro.datasets.shard_reader import ShardReader
from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class StoredScene:
    """A clip of a data set with its labels and metadata.

    Args:
        clip: audio and image.
        labels: true azimuths.
        metadata: values in degrees, metres and seconds.
    """

    clip: Clip
    labels: SceneLabels
    metadata: dict[str, Any]


class SceneDataset(Dataset[Clip]):
    """Clips by index; labels and metadata have methods of their own, so that training cannot use them by mistake.

    Sizes of shards are checked at once; the checksum of a shard is checked before its first scene is read, in each
    process. The dataset may be pickled and forked at any time.

    Args:
        folders: one or more folders of shards, concatenated.
        array: array of the returned audio; by default the rendered array of the first folder.
        channels: instead of ``array``, channels of the first folder's rendered array, counted from 0.

    Raises:
        InputError: a folder is no finished dataset, or its array lacks a microphone of ``array``.
    """

    def __init__(
        self,
        folders: Path | Sequence[Path],
        array: MicrophoneArray | None = None,
        channels: Sequence[int] | None = None,
    ) -> None:
        folders = [folders] if isinstance(folders, Path) else list(folders)
        if not folders:
            raise InputError("no folder of scenes was given; give at least one.")
        self._readers = [ShardReader(folder) for folder in folders]
        rendered = self._readers[0].manifest.spec.array
        if channels is not None:
            array = _selected(rendered, channels, array, where=str(folders[0]))
        self._array = rendered if array is None else array
        self._channels = [
            matching_channels(reader.manifest.spec.array, self._array, where=str(reader.folder))
            for reader in self._readers
        ]
        self._shards = [
            (number, shard)
            for number, reader in enumerate(self._readers)
            for shard in range(len(reader.manifest.shards))
        ]
        self._ends = list(accumulate(self.shard_sizes))

    @property
    def array(self) -> MicrophoneArray:
        """Array whose microphones are the channels of the clips, in order."""
        return self._array

    @property
    def shard_sizes(self) -> tuple[int, ...]:
        """Scenes per shard over all folders, in the order of the dataset's indices."""
        return tuple(shard.num_scenes for reader in self._readers for shard in reader.manifest.shards)

    @property
    def fingerprint(self) -> str:
        """Hexadecimal SHA-256 of the folders' manifests, equal for equal scenes in any folder."""
        manifests = [reader.manifest.to_dict() for reader in self._readers]
        return hashlib.sha256(to_json(manifests)).hexdigest()

    def __len__(self) -> int:
        return self._ends[-1]

    def __getitem__(self, index: int) -> Clip:
        """Reads one clip, without labels.

        Raises:
            IndexError: the index is out of range.
            InputError: the shard is damaged.
        """
        number, shard, position = self._locate(index)
        reader, channels = self._readers[number], self._channels[number]
        rendered = reader.manifest.spec.array.num_microphones
        key = reader.entry(shard, position).key
        where = reader.where(shard, position)
        extension = AUDIO_EXTENSIONS[rendered > FLAC_MAX_CHANNELS]
        audio_mn = decode_audio(reader.read(shard, position, extension), where)
        if len(audio_mn) != rendered:
            raise InputError(f"{where}: the audio has {len(audio_mn)} channels; the manifest's array has {rendered}.")
        image_ijc = decode_image(reader.read(shard, position, IMAGE_EXTENSION), where)
        return Clip(key, np.ascontiguousarray(audio_mn[list(channels)]), image_ijc)

    def labels(self, index: int) -> SceneLabels:
        """Reads the true azimuths of a scene, radians, for evaluation only.

        Raises:
            InputError: the scene has no labels, or its shard is damaged.
        """
        labels = self._metadata(index)[0]
        if labels is None:
            number, shard, position = self._locate(index)
            where = self._readers[number].where(shard, position)
            raise InputError(f"{where} has no labels, as it comes from a recording; evaluate on labelled scenes.")
        return labels

    def scene(self, index: int) -> StoredScene:
        """Reads a scene with its labels and metadata, for evaluation only; see :meth:`labels`."""
        return StoredScene(self[index], self.labels(index), self.metadata(index))

    def metadata(self, index: int) -> dict[str, Any]:
        """Reads the metadata stored with a scene, in degrees, metres and seconds."""
        return self._metadata(index)[1]

    def _metadata(self, index: int) -> tuple[SceneLabels | None, dict[str, Any]]:
        number, shard, position = self._locate(index)
        reader = self._readers[number]
        content = reader.read(shard, position, METADATA_EXTENSION)
        return decode_metadata(content, reader.where(shard, position))

    def _locate(self, index: int) -> tuple[int, int, int]:
        if not -len(self) <= index < len(self):
            raise IndexError(f"scene {index} of a dataset of {len(self)}")
        index %= len(self)
        place = int(np.searchsorted(self._ends, index, side="right"))
        number, shard = self._shards[place]
        first = self._ends[place - 1] if place else 0
        return number, shard, index - first


class LabeledClips(Sequence[tuple[Clip, SceneLabels]]):
    """Pairs of clip and labels of a dataset, read on access."""

    def __init__(self, dataset: SceneDataset) -> None:
        self._dataset = dataset

    @property
    def fingerprint(self) -> str:
        """Fingerprint of the dataset, see :attr:`SceneDataset.fingerprint`."""
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


def _selected(
    rendered: MicrophoneArray, channels: Sequence[int], array: MicrophoneArray | None, where: str
) -> MicrophoneArray:
    if array is not None:
        raise InputError(f"{where}: give either an array or channels, not both.")
    for channel in channels:
        if not 0 <= channel < rendered.num_microphones:
            raise InputError(
                f"{where}: channel {channel} does not exist; array '{rendered.name}' has 0 to "
                f"{rendered.num_microphones - 1}."
            )
    return rendered.select(tuple(channels))

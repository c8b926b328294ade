"""Random access to the scenes of a folder of shards, with a checksum test of each shard before its first use."""

import os
from collections import OrderedDict
from pathlib import Path
from typing import Any

from avssl_pyro.datasets.manifest import Manifest
from avssl_pyro.datasets.shards import SceneEntry, index_shard, shard_problem
from avssl_pyro.errors import InputError

_MAX_OPEN_SHARDS = 64


class ShardReader:
    """Reads the files of scenes by shard and position.

    Each process opens, checks and indexes shards on first use, so a reader can be pickled or forked at any time.

    Args:
        folder: folder of the shards.

    Raises:
        InputError: the manifest is missing or damaged, or a shard is missing or has another size.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.manifest = Manifest.load(folder)
        for shard in self.manifest.shards:
            problem = shard_problem(folder, shard, contents=False)
            if problem is not None:
                raise InputError(problem)
        self._reset()

    def _reset(self) -> None:
        self._entries: dict[int, tuple[SceneEntry, ...]] = {}
        self._checked: dict[int, tuple[int, int]] = {}
        self._descriptors: OrderedDict[int, int] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        return {"folder": self.folder, "manifest": self.manifest}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._reset()

    def __del__(self) -> None:
        for descriptor in getattr(self, "_descriptors", {}).values():
            os.close(descriptor)

    def entry(self, shard: int, position: int) -> SceneEntry:
        """Returns the entry of a scene; raises InputError if the shard is damaged."""
        self._open(shard)
        return self._entries[shard][position]

    def read(self, shard: int, position: int, extension: str) -> bytes:
        """Reads one file of a scene.

        Raises:
            InputError: the shard is damaged or the scene has no such file.
        """
        descriptor = self._open(shard)
        entry = self._entries[shard][position]
        if extension not in entry.files:
            raise InputError(f"{self.where(shard, position)} has no .{extension} file; make the scenes again.")
        offset, size = entry.files[extension]
        return _read_at(descriptor, size, offset)

    def where(self, shard: int, position: int) -> str:
        """Names a scene and its shard, for messages."""
        name = self.manifest.shards[shard].name
        return f"scene '{self._entries[shard][position].key}' of shard {self.folder / name}"

    def _open(self, shard: int) -> int:
        if shard in self._descriptors:
            self._descriptors.move_to_end(shard)
            return self._descriptors[shard]
        record = self.manifest.shards[shard]
        path = self.folder / record.name
        try:
            status = path.stat()
            unchanged = self._checked.get(shard) == (status.st_size, status.st_mtime_ns)
            problem = None if unchanged else shard_problem(self.folder, record)
            if problem is None and not unchanged:
                self._entries[shard] = index_shard(path)
                if len(self._entries[shard]) != record.num_scenes:
                    problem = f"shard {path} holds {len(self._entries[shard])} scenes, not {record.num_scenes}."
            if problem is not None:
                raise InputError(problem)
            self._checked[shard] = (status.st_size, status.st_mtime_ns)
            descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
        except OSError as error:
            raise InputError(
                f"shard {path} cannot be read ({error.strerror}); check that it exists and may be read."
            ) from error
        self._descriptors[shard] = descriptor
        if len(self._descriptors) > _MAX_OPEN_SHARDS:
            os.close(self._descriptors.popitem(last=False)[1])
        return descriptor


def _read_at(descriptor: int, size: int, offset: int) -> bytes:
    # A forked process shares the position of its parent's file; where there is no pread, processes are not forked.
    if hasattr(os, "pread"):
        return os.pread(descriptor, size, offset)
    os.lseek(descriptor, offset, os.SEEK_SET)
    return os.read(descriptor, size)

"""Shards: tar archives in the WebDataset convention, KEY.flac KEY.jpg KEY.json per scene, equal to the last byte."""

import hashlib
import io
import tarfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from avssl_pyro.datasets.encoding import Scene, encode_scene
from avssl_pyro.datasets.manifest import ShardRecord
from avssl_pyro.errors import InputError

_BLOCK_BYTES = 1 << 20


def build_shard(scenes: Iterable[Scene]) -> bytes:
    """The tar archive of some scenes; the same scenes give the same bytes on any machine at any time.

    Raises:
        InputError: see :func:`encode_scene`.
    """
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for scene in scenes:
            for extension, content in encode_scene(scene).items():
                # A fresh TarInfo has time, owner and group 0 and mode 644.
                header = tarfile.TarInfo(f"{scene.clip.key}.{extension}")
                header.size = len(content)
                archive.addfile(header, io.BytesIO(content))
    return stream.getvalue()


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK_BYTES):
            digest.update(block)
    return digest.hexdigest()


def shard_problem(folder: Path, shard: ShardRecord, contents: bool = True) -> str | None:
    """What is wrong with a shard, as a sentence that names it, or None; ``contents`` compares the checksum too."""
    path = folder / shard.name
    if not path.is_file():
        return f"shard {path} is missing; run the command that made it with the same settings to make it again."
    found = path.stat().st_size
    if found != shard.num_bytes:
        state = "truncated" if found < shard.num_bytes else "altered"
        return f"shard {path} is {state}: it has {found} bytes, the manifest says {shard.num_bytes}."
    if contents and file_sha256(path) != shard.sha256:
        return f"shard {path} is altered: its SHA-256 is not the manifest's; delete it and make it again."
    return None


@dataclass(frozen=True)
class SceneEntry:
    """Where the files of one scene lie in a shard: extension to (offset, size), bytes."""

    key: str
    files: dict[str, tuple[int, int]]


def index_shard(path: Path) -> tuple[SceneEntry, ...]:
    """Reads the headers of a shard, not its contents.

    Raises:
        InputError: it is no tar archive.
    """
    entries: dict[str, dict[str, tuple[int, int]]] = {}
    try:
        with tarfile.open(path, mode="r:") as archive:
            for member in archive:
                key, _, extension = member.name.partition(".")
                entries.setdefault(key, {})[extension] = (member.offset_data, member.size)
    except tarfile.TarError as error:
        raise InputError(f"shard {path} is no tar archive ({error}).") from error
    return tuple(SceneEntry(key, files) for key, files in entries.items())

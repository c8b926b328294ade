"""Shards: reproducible tar archives with KEY.flac, KEY.jpg and KEY.json per scene (WebDataset convention)."""

import hashlib
import io
import tarfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from avssl_pyro.datasets.encoding import Scene, encode_scene
from avssl_pyro.datasets.manifest import Manifest, ShardRecord
from avssl_pyro.errors import InputError

_BLOCK_BYTES = 1 << 20


def build_shard(scenes: Iterable[Scene]) -> bytes:
    """Builds the tar archive of scenes; equal scenes give equal bytes on every machine.

    Raises:
        InputError: see :func:`encode_scene`.
    """
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for scene in scenes:
            for extension, content in encode_scene(scene).items():
                # A new TarInfo has time, owner and group 0 and mode 644.
                header = tarfile.TarInfo(f"{scene.clip.key}.{extension}")
                header.size = len(content)
                archive.addfile(header, io.BytesIO(content))
    return stream.getvalue()


def file_sha256(path: Path) -> str:
    """Returns the hexadecimal SHA-256 of a file."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK_BYTES):
            digest.update(block)
    return digest.hexdigest()


def shard_problem(folder: Path, shard: ShardRecord, contents: bool = True) -> str | None:
    """Returns a sentence on what is wrong with a shard, or None; ``contents`` includes the checksum."""
    path = folder / shard.name
    if not path.is_file():
        return f"shard {path} is missing; run the command that made it with the same settings to make it again."
    found = path.stat().st_size
    if found != shard.num_bytes:
        state = "truncated" if found < shard.num_bytes else "altered"
        return f"shard {path} is {state}: it has {found} bytes, the manifest has {shard.num_bytes}."
    if contents and file_sha256(path) != shard.sha256:
        return f"shard {path} is altered: its SHA-256 is not the manifest's; delete it and make it again."
    return None


@dataclass(frozen=True)
class SceneEntry:
    """Offset and size in bytes of the files of one scene in a shard, by extension."""

    key: str
    files: dict[str, tuple[int, int]]


def index_shard(path: Path) -> tuple[SceneEntry, ...]:
    """Reads the headers of a shard.

    Raises:
        InputError: the file is no tar archive.
    """
    entries: dict[str, dict[str, tuple[int, int]]] = {}
    try:
        with tarfile.open(path, mode="r:") as archive:
            for member in archive:
                key, _, extension = member.name.partition(".")
                entries.setdefault(key, {})[extension] = (member.offset_data, member.size)
    except tarfile.TarError as error:
        raise InputError(f"shard {path} is no tar archive ({error}); delete it and make it again.") from error
    return tuple(SceneEntry(key, files) for key, files in entries.items())


def verify_dataset(folder: Path, progress: bool = False) -> list[str]:
    """Reads a whole dataset and returns its problems, one sentence each; an intact dataset has none.

    Problems are missing, truncated, altered and surplus shards, and a missing or damaged manifest.
    """
    if not folder.is_dir():
        return [f"{folder}: no such folder."]
    try:
        manifest = Manifest.load(folder)
    except InputError as error:
        return [str(error)]
    shards = tqdm(manifest.shards, desc="verify", unit="shard", disable=not progress)
    problems = [problem for shard in shards if (problem := shard_problem(folder, shard)) is not None]
    known = {shard.name for shard in manifest.shards}
    surplus = sorted(path for path in folder.glob("*.tar") if path.name not in known)
    return problems + [f"shard {path} is not in the manifest; delete it." for path in surplus]

"""Checking a folder of shards against its manifest."""

from pathlib import Path

from tqdm import tqdm

from avssl_pyro.datasets.manifest import Manifest
from avssl_pyro.datasets.shards import shard_problem
from avssl_pyro.errors import InputError


def verify(folder: Path, progress: bool = False) -> list[str]:
    """Reads every byte of a dataset and returns its problems, one sentence each; an empty list means it is sound.

    Named are missing, truncated, altered and surplus shards, and a missing or damaged manifest.
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

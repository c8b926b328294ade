"""Folders of assets (speech, cut-outs, panoramas) from which a simulation draws."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class AssetFolder:
    """Assets of one kind anywhere under a folder.

    Args:
        folder: folder with the files.

    Raises:
        InputError: the folder is missing or has no such file.
    """

    suffixes: ClassVar[frozenset[str]]
    """File suffixes, lower case, with dot."""
    kind: ClassVar[str]
    """Adjective in messages."""
    plural: ClassVar[str]
    """Noun in :meth:`describe`."""

    folder: Path
    paths: tuple[Path, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "paths", list_assets(self.folder, self.suffixes, self.kind))

    @property
    def name(self) -> str:
        return f"folder:{self.folder}"

    def describe(self) -> str:
        return f"{len(self.paths)} {self.plural} of {self.folder}"


def list_assets(folder: Path, suffixes: frozenset[str], kind: str) -> tuple[Path, ...]:
    """Paths of all files with the given suffixes under ``folder``, sorted alike on every machine.

    Args:
        folder: folder to search.
        suffixes: file suffixes, lower case, with dot.
        kind: adjective in messages.

    Raises:
        InputError: the folder is missing or has no such file.
    """
    wanted = ", ".join(sorted(suffixes))
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give a folder of {kind} files ({wanted}).")
    paths = [path for path in folder.rglob("*") if path.suffix.lower() in suffixes and path.is_file()]
    if not paths:
        raise InputError(f"{folder}: has no {kind} file; give at least one of {wanted}.")
    return tuple(sorted(paths, key=lambda path: path.relative_to(folder).as_posix()))

"""Folders of material (speech, people, panoramas) that a user points the simulation at."""

from pathlib import Path

from avssl_pyro.errors import InputError


def list_assets(folder: Path, suffixes: frozenset[str], what: str) -> tuple[Path, ...]:
    """Files of the given suffixes (lower case, with dot) anywhere under ``folder``, in an order free of the machine.

    Raises:
        InputError: the folder is missing or holds no such file.
    """
    wanted = ", ".join(sorted(suffixes))
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give a folder of {what} files ({wanted}).")
    paths = [path for path in folder.rglob("*") if path.suffix.lower() in suffixes and path.is_file()]
    if not paths:
        raise InputError(f"{folder}: holds no {what} file; {wanted} are read.")
    return tuple(sorted(paths, key=lambda path: path.relative_to(folder).as_posix()))

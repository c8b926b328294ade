"""Checks of the files that a command is about to write."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from avssl_pyro.errors import InputError


def check_outputs(outputs: Sequence[Path | None], inputs: Sequence[Path | None]) -> None:
    """Makes sure before long work that its results can be written, and makes their folders.

    Args:
        outputs: files to write; None for those that were not asked for.
        inputs: files that are read.

    Raises:
        InputError: an output is no regular file, or would replace an input or another output.
        OSError: its folder cannot be made or written.
    """
    taken = [path.resolve() for path in inputs if path is not None]
    for path in outputs:
        if path is None:
            continue
        if path.resolve() in taken:
            raise InputError(f"{path}: is read or written by the same command already; give every output its own name.")
        taken.append(path.resolve())
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: is not a regular file; name a file that may be made or replaced.")
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass

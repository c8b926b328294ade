"""Atomic file writing: a reader finds the whole file or none, even if the writer is killed."""

import contextlib
import os
import uuid
from collections.abc import Iterator
from pathlib import Path

from avssl_pyro.errors import InputError

TEMPORARY_SUFFIX = ".partial"


@contextlib.contextmanager
def atomic_replacement(path: Path) -> Iterator[Path]:
    """Yields a hidden file next to ``path``, and renames it if the body succeeds; after an error it is removed.

    Raises:
        InputError: ``path`` exists and is no regular file, for example a device.
        OSError: the file cannot be written, with ``filename`` set to ``path``.
    """
    if path.exists() and not path.is_file():
        raise InputError(f"{path} is not a regular file; give a file that may be created or replaced.")
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}{TEMPORARY_SUFFIX}")
    try:
        yield temporary
        with temporary.open("rb+") as stream:
            # Without this a power cut can leave the new name in place with none of the bytes.
            os.fsync(stream.fileno())
        temporary.replace(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError) and error.filename in (None, str(temporary)):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def write_atomically(path: Path, content: bytes) -> None:
    """Writes ``content`` to ``path``; see :func:`atomic_replacement`."""
    with atomic_replacement(path) as temporary:
        temporary.write_bytes(content)


def remove_temporaries(folder: Path) -> None:
    """Removes the hidden files that killed writers left in ``folder``."""
    for temporary in folder.glob(f".*{TEMPORARY_SUFFIX}"):
        temporary.unlink(missing_ok=True)

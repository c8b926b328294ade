"""Writing files so that a reader sees either the whole of one or none of it, whatever kills the writer."""

import contextlib
import os
import uuid
from pathlib import Path

from avssl_pyro.errors import InputError

TEMPORARY_SUFFIX = ".partial"


def write_atomically(path: Path, content: bytes) -> None:
    """Writes to a hidden neighbour of ``path``, then renames it into place.

    Raises:
        InputError: ``path`` is there and not a regular file, such as a device, which renaming would replace.
        OSError: with ``filename`` set to ``path``; nothing is left behind.
    """
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is not a regular file; name a file that may be made or replaced.")
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}{TEMPORARY_SUFFIX}")
    try:
        with temporary.open("xb") as stream:
            stream.write(content)
            stream.flush()
            # Without this a power cut can leave the new name in place with none of the bytes.
            os.fsync(stream.fileno())
        temporary.replace(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def remove_temporaries(folder: Path) -> None:
    """Removes what killed writers left in ``folder``."""
    for temporary in folder.glob(f".*{TEMPORARY_SUFFIX}"):
        temporary.unlink(missing_ok=True)

"""One writer per folder: a second one waits for the first."""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Holds an advisory lock on ``folder`` itself, which the system drops with the process, however that ends.

    Where folders cannot be locked (some network mounts) nothing keeps two writers apart, which is said on stderr.
    """
    try:
        import fcntl  # noqa: PLC0415
    except ImportError:
        print(f"{folder} cannot be locked on this system; let only one command write to it.", file=sys.stderr)
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print(f"another process is making scenes in {folder}; waiting for it ...", file=sys.stderr)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        except OSError:
            print(f"{folder} cannot be locked on this file system; let only one command write to it.", file=sys.stderr)
        yield
    finally:
        os.close(descriptor)

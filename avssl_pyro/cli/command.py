"""How every command ends: exit codes, and one sentence instead of a traceback when input or disk is at fault."""

import errno
import os
import sys
from collections.abc import Callable
from typing import NoReturn

from avssl_pyro.errors import InputError

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


def describe_os_error(error: OSError) -> str:
    """One sentence for a missing file, a full disk, a permission; the file comes first where it is known."""
    where = f"{error.filename}: " if error.filename is not None else ""
    match error.errno:
        case errno.ENOSPC | errno.EDQUOT:
            return f"{where}no space is left on the disk; free some and run the same command again."
        case errno.ENOENT:
            return f"{where}no such file or folder."
        case errno.EACCES | errno.EPERM | errno.EROFS:
            return f"{where}permission denied; choose a place that can be read and written."
        case errno.EISDIR:
            return f"{where}is a folder where a file is expected."
        case errno.ENOTDIR | errno.EEXIST:
            return f"{where}is a file where a folder is expected."
        case _:
            return f"{where}{error.strerror or ' '.join(str(error).split()) or type(error).__name__}."


def run(main: Callable[[], int | None]) -> NoReturn:
    """Runs a command and leaves the process with its exit code.

    0 (or what ``main`` returns) on success, 2 with one sentence on stderr for :class:`InputError` and :class:`OSError`,
    130 for ctrl-C. Anything else is a defect of this package and keeps its traceback.
    """
    try:
        code = main() or 0
        sys.stdout.flush()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(EXIT_BAD_INPUT)
    except BrokenPipeError:
        # The reader of a pipe (head, less) left; Python's own flush at exit must not complain about it a second time.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        print(f"error: {describe_os_error(error)}", file=sys.stderr)
        sys.exit(EXIT_BAD_INPUT)
    except KeyboardInterrupt:
        print("interrupted; run the same command again to continue where it stopped.", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
    sys.exit(code)

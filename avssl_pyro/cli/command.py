"""Exit codes of commands, and one sentence per bad input or failing disk."""

import errno
import os
import sys
from collections.abc import Callable
from typing import NoReturn

from avssl_pyro.errors import InputError

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


def describe_os_error(error: OSError) -> str:
    """Returns one sentence on an OSError, which begins with the file if it is known."""
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
    """Runs a command and ends the process with its exit code.

    The code is the result of ``main`` (0 for None), 2 for :class:`InputError` and :class:`OSError`, which are reported
    in one sentence on standard error, or 130 for ctrl-C. Other exceptions are defects and keep their traceback.

    Args:
        main: function that runs the command and returns its exit code, or None for 0.
    """
    try:
        code = main() or 0
        sys.stdout.flush()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(EXIT_BAD_INPUT)
    except BrokenPipeError:
        # The reader of the pipe (head, less) has closed it; Python's flush at exit would raise the error again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        print(f"error: {describe_os_error(error)}", file=sys.stderr)
        sys.exit(EXIT_BAD_INPUT)
    except KeyboardInterrupt:
        print("interrupted; run the same command again to continue where it stopped.", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
    sys.exit(code)

"""State of the whole process that training sets: memory of the C library, Pyro's settings, random numbers."""

import contextlib
import ctypes
import sys
import warnings
from collections.abc import Iterator

import numpy as np
import pyro
import torch

# Parameters of glibc's mallopt(3).
M_TRIM_THRESHOLD, M_TOP_PAD, M_MMAP_MAX = -1, -2, -4


def keep_freed_memory() -> bool:
    """Keeps freed memory in the process (glibc); for commands only, since it holds for the whole process.

    Every training step allocates and frees the same few hundred MB. By default glibc maps each large block anew and the
    system clears it page by page, which takes a fifth of a step on two cores. Peak memory does not change.

    Returns:
        Whether the C library is glibc; others are left as they are.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL("libc.so.6").mallopt
    except (OSError, AttributeError):
        return False
    return all(
        mallopt(parameter, value) == 1
        for parameter, value in ((M_MMAP_MAX, 0), (M_TRIM_THRESHOLD, 2**31 - 1), (M_TOP_PAD, 2**27))
    )


@contextlib.contextmanager
def private_pyro() -> Iterator[None]:
    """Keeps parameters in their modules, out of Pyro's global store, and turns off Pyro's own checks for NaN.

    The training loop checks for NaN itself, because it has the step, the term and the clip for the message.
    """
    local_parameters = pyro.settings.context(module_local_params=True)
    with local_parameters, pyro.validation_enabled(False), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Encountered NaN", category=UserWarning)
        yield


def seed_step(seed: int, step: int, rank: int) -> None:
    """Seeds torch's global generator from (seed, step, rank), so that a resumed run repeats its numbers."""
    (state,) = np.random.SeedSequence([seed, step, rank]).generate_state(1, np.uint64)
    torch.manual_seed(int(state) >> 1)

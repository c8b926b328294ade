"""The trained system that a command's ``--checkpoint`` and ``--array`` name."""

import sys
from pathlib import Path

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.errors import InputError
from avssl_pyro.systems.checkpoint import load_checkpoint
from avssl_pyro.systems.pretrained import load_pretrained
from avssl_pyro.systems.system import System
from avssl_pyro.systems.trained_array import check_array


def choose_system(
    checkpoint: Path | None, array: str | None, default_array: str | None = None
) -> tuple[System, MicrophoneArray]:
    """The system of a checkpoint, or the weights that come with the package, which is said on stderr then.

    Args:
        checkpoint: of svi_train.py.
        array: preset or YAML file of the array to serve; a checkpoint knows its own, and is checked against this one.
        default_array: where neither is given.

    Returns:
        The system and the array to serve, which may have its microphones on other channels than the system's own.

    Raises:
        InputError: a file cannot be read, the checkpoint was trained for another array, or nothing names one.
    """
    served = None if array is None else resolve_array(array)
    if checkpoint is not None:
        system = load_checkpoint(checkpoint)
        if served is None:
            return system, system.config.array
        check_array(system, served, str(checkpoint))
        return system, served
    if served is None:
        if default_array is None:
            raise InputError(
                "give --array, the microphones that recorded: a preset or a YAML file; or give --checkpoint."
            )
        served = resolve_array(default_array)
    pretrained = load_pretrained(served)
    print(pretrained.sentence, file=sys.stderr)
    return pretrained.system, served

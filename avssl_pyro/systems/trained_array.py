"""Whether a system that was trained for one array may serve another."""

import numpy as np

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.errors import InputError
from avssl_pyro.systems.system import System

SAME_PLACE_M = 1e-3


def check_array(system: System, array: MicrophoneArray, where: str) -> None:
    """Refuses a system that was trained for another array.

    Args:
        system: read from a checkpoint.
        array: the microphones that recorded; which channels they are on does not matter.
        where: names the checkpoint.

    Raises:
        InputError: the numbers of microphones, their places, or the kinds of steering differ.
    """
    trained = system.config.array
    if trained.num_microphones != array.num_microphones:
        raise InputError(
            f"{where}: trained for array '{trained.name}' with {trained.num_microphones} microphones, but "
            f"'{array.name}' has {array.num_microphones}; give a checkpoint of this array."
        )
    if trained.steering != array.steering:
        raise InputError(
            f"{where}: trained for array '{trained.name}' {trained.steering.description}, but '{array.name}' hears "
            f"{array.steering.description}; give a checkpoint of this array."
        )
    if len(trained.positions) != len(array.positions):
        return  # Of measured responses, positions are a remark.
    distances_m = np.linalg.norm(trained.positions - array.positions, axis=-1)
    if distances_m.max(initial=0.0) > SAME_PLACE_M:
        worst = int(distances_m.argmax())
        raise InputError(
            f"{where}: trained for array '{trained.name}', whose microphone {worst + 1} is "
            f"{100 * distances_m[worst]:.1f} cm from that of '{array.name}'; give a checkpoint of this array."
        )

"""Reading one array's recording as another's: which channels stand at the microphones that are asked for."""

import numpy as np

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.errors import InputError

POSITION_TOLERANCE_M = 1e-4


def matching_channels(recorded: MicrophoneArray, wanted: MicrophoneArray, where: str) -> tuple[int, ...]:
    """Channels of ``recorded``, counted from 0, in the order of the microphones of ``wanted``.

    Raises:
        InputError: the two do not hear by the same kind of steering, or a microphone of ``wanted`` is not within 0.1 mm
            of any of ``recorded``; both are named.
    """
    if recorded.steering != wanted.steering:
        raise InputError(
            f"{where}: it was recorded with array '{recorded.name}' {recorded.steering.description}, but array "
            f"'{wanted.name}' hears {wanted.steering.description}; give a recording of that array."
        )
    if wanted.steering.num_microphones is not None:
        # Their channels have an order of their own, whatever positions the files give.
        return tuple(range(wanted.num_microphones))
    distance_wr = np.linalg.norm(wanted.positions[:, None] - recorded.positions[None], axis=-1)
    channels = tuple(int(channel) for channel in distance_wr.argmin(axis=1))
    for microphone, channel in enumerate(channels):
        if distance_wr[microphone, channel] > POSITION_TOLERANCE_M:
            raise InputError(
                f"{where}: it was recorded with array '{recorded.name}', which has no microphone at "
                f"{wanted.positions_m[microphone]} m, where array '{wanted.name}' has its microphone {microphone + 1}."
            )
    return channels

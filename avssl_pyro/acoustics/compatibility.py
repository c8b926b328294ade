"""Checks of whether a recording, another array or trained weights fit an array."""

import numpy as np

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.errors import InputError

# Two microphones of one recording are the same one within the first; weights serve an array within the second.
POSITION_TOLERANCE_M = 1e-4
SAME_PLACE_M = 1e-3


def check_channels(found: int, array: MicrophoneArray, where: str) -> None:
    """Checks that a recording of ``found`` channels has those of the array, and no others without a channel map.

    Raises:
        InputError: the array has no channel map and the numbers differ, or a channel of the map does not exist.
    """
    if array.channels is None and found != array.num_microphones:
        raise InputError(
            f"{where}: {found} channel(s), but array '{array.name}' has {array.num_microphones} microphones; give a "
            "recording of that array, one channel per microphone, or say in the array's file under 'channels' which "
            "are its own."
        )
    if array.channels is not None and found < max(array.channels):
        microphone = array.channels.index(max(array.channels)) + 1
        raise InputError(
            f"{where}: {found} channel(s), but microphone {microphone} of array '{array.name}' is on channel "
            f"{max(array.channels)}; give a recording with all channels, or another channel map."
        )


def matching_channels(recorded: MicrophoneArray, wanted: MicrophoneArray, where: str) -> tuple[int, ...]:
    """Returns the channels of ``recorded``, counted from 0, in the order of the microphones of ``wanted``.

    Raises:
        InputError: the kinds of steering differ, or a microphone of ``wanted`` is not within 0.1 mm of any of
            ``recorded``.
    """
    if recorded.steering != wanted.steering:
        raise InputError(
            f"{where}: it was recorded with array '{recorded.name}' {recorded.steering.description}, but array "
            f"'{wanted.name}' is {wanted.steering.description}; give a recording of that array."
        )
    if wanted.steering.num_microphones is not None:
        # The kind of steering fixes the order of the channels, whatever positions the files give.
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


def check_trained_array(trained: MicrophoneArray, array: MicrophoneArray, where: str) -> None:
    """Checks that weights trained for one array may serve another.

    Args:
        trained: array that the weights were trained for.
        array: microphones that recorded; their channels do not matter.
        where: name of the checkpoint in error messages.

    Raises:
        InputError: the numbers of microphones, their positions, or the kinds of steering differ.
    """
    if trained.num_microphones != array.num_microphones:
        raise InputError(
            f"{where}: trained for array '{trained.name}' with {trained.num_microphones} microphones, but "
            f"'{array.name}' has {array.num_microphones}; give a checkpoint of this array."
        )
    if trained.steering != array.steering:
        raise InputError(
            f"{where}: trained for array '{trained.name}' {trained.steering.description}, but '{array.name}' is "
            f"{array.steering.description}; give a checkpoint of this array."
        )
    if len(trained.positions) != len(array.positions):
        return  # Measured responses replace positions, which are a remark.
    distances_m = np.linalg.norm(trained.positions - array.positions, axis=-1)
    if distances_m.max(initial=0.0) > SAME_PLACE_M:
        worst = int(distances_m.argmax())
        raise InputError(
            f"{where}: trained for array '{trained.name}', whose microphone {worst + 1} is "
            f"{100 * distances_m[worst]:.1f} cm from that of '{array.name}'; give a checkpoint of this array."
        )


def is_same_array(trained: MicrophoneArray, array: MicrophoneArray) -> bool:
    """Whether two arrays agree in steering, speed of sound and positions; channels do not matter."""
    if (trained.steering, trained.speed_of_sound) != (array.steering, array.speed_of_sound):
        return False
    if trained.positions.shape != array.positions.shape:
        return False
    return bool(np.linalg.norm(trained.positions - array.positions, axis=-1).max() <= SAME_PLACE_M)

"""Impulse responses of a shoe-box room by the image method (Allen and Berkley 1979), computed by pyroomacoustics."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from math import ceil
from threading import Lock

import numpy as np
import numpy.typing as npt
import pyroomacoustics as pra
from scipy import fft

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.steering_kinds import FreeFieldKind
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.simulation.plane_waves import PlaneWaveReceiver, Waves

ORDERS_PER_SECOND = 60.0
FRACTIONAL_DELAY_TAPS = 41
RENDERING_CONSTANTS: dict[str, int | bool] = {
    # With several threads pyroomacoustics adds reflections in another order: the bits would depend on the machine.
    "num_threads": 1,
    # Half the usual length: twice as fast, flat to 7 kHz.
    "frac_delay_length": FRACTIONAL_DELAY_TAPS,
    # Done once per talker in :func:`reverberate` instead of once per response.
    "rir_hpf_enable": False,
}
# The image method adds positive echoes only, so direct current piles up (Allen and Berkley); voices hold none.
HIGH_PASS_HZ = 20.0
_CONSTANTS_LOCK = Lock()


def truncation_order(rt60_s: float) -> int:
    """Highest reflection order that is rendered, ``ceil(60 RT60)``: 12 at 0.2 s, 24 at 0.4 s.

    In the 5 x 5 x 3 m room every reflection of the first 0.40 RT60 (24 dB of decay) is there; later ones are there in
    part. Measured against full orders (27 to 53, all reflections within RT60) on 30 random sources at 0.5-2.0 m, above
    20 Hz: the missing energy is 0.003 % of a response at RT60 0.2 s, 0.02 % at 0.3 s and 0.03 % at 0.4 s (0.042 % or
    -34 dB at worst, 14 dB below the noise of a scene); 0.3-0.6 % of what comes later than 50 ms after the direct sound;
    about 30 % of what comes later than RT60 / 2. Reverberation times (T20) come out at most 2 % shorter.
    """
    return ceil(ORDERS_PER_SECOND * rt60_s)


def room_responses(
    array: MicrophoneArray,
    sources_sx: npt.NDArray[np.float64],
    *,
    room_dims_m: tuple[float, float, float],
    height_m: float,
    room_yaw: float,
    rt60_s: float,
    max_order: int | None = None,
) -> npt.NDArray[np.float32]:
    """Responses from each source to each microphone of an array whose origin stands over the middle of the floor.

    In free field every microphone has reflections of its own; other arrays hear plane waves, see
    :mod:`avssl_pyro.simulation.plane_waves`.

    Args:
        array: M microphones, or channels.
        sources_sx: sources (S, 3), metres, in the array's own axes (x forward, y left, z up from the array's origin).
        room_dims_m: length, width and height of the room.
        height_m: height of the array's origin above the floor.
        room_yaw: azimuth of the room's own x axis seen from the array, radians.
        rt60_s: reverberation time; Sabine's formula gives the absorption, the same for all walls and frequencies.
        max_order: highest reflection order, :func:`truncation_order` by default; 0 keeps the direct path alone.

    Returns:
        Responses (S, M, L), float32, 16 kHz, padded with zeros to the longest. All lag by the half length of
        the fractional delay filters (20 samples; for plane waves, that of the array's responses) and decay with
        1 / distance in metres.

    Raises:
        InputError: the array's responses are measured ones.
    """
    absorption, _ = pra.inverse_sabine(rt60_s, room_dims_m)
    order = truncation_order(rt60_s) if max_order is None else max_order
    room = pra.ShoeBox(room_dims_m, fs=SAMPLE_RATE, materials=pra.Material(absorption), max_order=order)
    room.set_sound_speed(array.speed_of_sound)
    centre = np.array([room_dims_m[0] / 2, room_dims_m[1] / 2, height_m])
    cos, sin = np.cos(room_yaw), np.sin(room_yaw)
    to_room = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    is_open = array.steering == FreeFieldKind()
    room.add_microphone_array((array.positions @ to_room.T + centre).T if is_open else centre[:, None])
    for position in sources_sx @ to_room.T + centre:
        room.add_source(position)
    per_source = _at_points(room) if is_open else _at_receiver(room, _receiver(array), centre, to_room)
    longest = max((response_ml.shape[1] for response_ml in per_source), default=0)
    responses_sml = np.zeros((len(sources_sx), array.num_microphones, longest), dtype=np.float32)
    for s, response_ml in enumerate(per_source):
        responses_sml[s, :, : response_ml.shape[1]] = response_ml
    return responses_sml


def _at_points(room: pra.ShoeBox) -> list[npt.NDArray[np.float32]]:
    """Responses (M, L) of each source, one microphone at a time."""
    with _rendering_constants():
        room.compute_rir()
    responses = []
    for per_microphone in zip(*room.rir, strict=True):
        longest = max(len(response) for response in per_microphone)
        padded = [np.pad(response, (0, longest - len(response))) for response in per_microphone]
        responses.append(np.array(padded, dtype=np.float32))
    return responses


def _at_receiver(
    room: pra.ShoeBox,
    receiver: PlaneWaveReceiver,
    centre: npt.NDArray[np.float64],
    to_room: npt.NDArray[np.float64],
) -> list[npt.NDArray[np.float32]]:
    """Responses (M, L) of each source, one reflection at a time."""
    room.image_source_model()
    responses = []
    for source in room.sources:
        offset_kx = (source.images.T.astype(np.float64) - centre) @ to_room
        distance_k = np.linalg.norm(offset_kx, axis=-1)
        order_k = np.argsort(distance_k, kind="stable")
        offset_kx, distance_k, damping_k = offset_kx[order_k], distance_k[order_k], source.damping[0, order_k]
        waves = Waves(offset_kx / distance_k[:, None], distance_k / room.c, damping_k / distance_k)
        responses.append(receiver.responses(waves))
    return responses


# Tables of responses are kept for the next scene.
@lru_cache(maxsize=2)
def _receiver(array: MicrophoneArray) -> PlaneWaveReceiver:
    return PlaneWaveReceiver(array)


@contextmanager
def _rendering_constants() -> Iterator[None]:
    # The constants belong to the whole process: threads of one worker must not restore them under each other's feet.
    with _CONSTANTS_LOCK:
        before = {name: pra.constants.get(name) for name in RENDERING_CONSTANTS}
        try:
            for name, value in RENDERING_CONSTANTS.items():
                pra.constants.set(name, value)
            yield
        finally:
            for name, value in before.items():
                pra.constants.set(name, value)


def reverberate(
    dry_n: npt.NDArray[np.float32], responses_ml: npt.NDArray[np.float32], num_samples: int
) -> npt.NDArray[np.float32]:
    """The last ``num_samples`` of ``dry_n`` as heard through each response, (M, num_samples), float32.

    What comes before them in ``dry_n`` fills the room, so that the clip does not begin in silence. Sound below 20 Hz
    is taken out, without any phase shift.
    """
    length = fft.next_fast_len(len(dry_n) + responses_ml.shape[-1] - 1, real=True)
    frequencies_f = np.arange(length // 2 + 1, dtype=np.float32) * (SAMPLE_RATE / length)
    high_pass_f = frequencies_f**2 / (frequencies_f**2 + HIGH_PASS_HZ**2)
    spectrum_mf = fft.rfft(responses_ml, length) * (fft.rfft(dry_n, length) * high_pass_f)
    wet_mn: npt.NDArray[np.float32] = fft.irfft(spectrum_mf, length)[:, len(dry_n) - num_samples : len(dry_n)]
    return np.ascontiguousarray(wet_mn)

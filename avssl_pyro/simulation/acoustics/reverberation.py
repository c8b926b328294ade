"""Impulse responses of a shoe-box room by the image method (Allen and Berkley 1979), with pyroomacoustics."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
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
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.acoustics.plane_waves import PlaneWaveReceiver, PlaneWaves

ORDERS_PER_SECOND = 60.0
FRACTIONAL_DELAY_TAPS = 41
RENDERING_CONSTANTS: dict[str, int | bool] = {
    # With several threads pyroomacoustics adds reflections in another order: the bits would depend on the machine.
    "num_threads": 1,
    # Half the usual length: twice as fast, flat to 7 kHz.
    "frac_delay_length": FRACTIONAL_DELAY_TAPS,
    # :func:`reverberate` does it once per talker instead of once per response.
    "rir_hpf_enable": False,
}
# The image method adds positive echoes only, which accumulate at 0 Hz (Allen and Berkley); voices have none there.
HIGH_PASS_HZ = 20.0
# Speech begins this long before a clip, so that the clip starts with reverberation.
LEAD_SAMPLES = SAMPLE_RATE // 5
# Longer reverberation needs an earlier beginning: the share of RT60 within which sound decays by 30 dB.
LEAD_SHARE = 0.5
_CONSTANTS_LOCK = Lock()


@dataclass(frozen=True)
class RoomAcoustics:
    """A room with an array, over the middle of its floor by default.

    Args:
        dims_m: length, width and height, metres.
        rt60_s: reverberation time, seconds.
        array_height_m: height of the array's origin above the floor, metres.
        room_yaw: azimuth of the room's x axis in the array's coordinates, radians.
        array_floor_m: place of the array along length and width, metres from a corner; None is the middle.
    """

    dims_m: tuple[float, float, float] = (5.0, 5.0, 3.0)
    rt60_s: float = 0.2
    array_height_m: float = 1.5
    room_yaw: float = 0.0
    array_floor_m: tuple[float, float] | None = None

    @property
    def array_position(self) -> npt.NDArray[np.float64]:
        """Position of the array's origin in the room, (3,), metres from a corner of the floor."""
        x, y = self.array_floor_m or (self.dims_m[0] / 2, self.dims_m[1] / 2)
        return np.array([x, y, self.array_height_m])

    @property
    def to_room(self) -> npt.NDArray[np.float64]:
        """Rotation from the array's coordinates to those of the room, (3, 3)."""
        cos, sin = np.cos(self.room_yaw), np.sin(self.room_yaw)
        return np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])


def eyring_absorption(rt60_s: float, dims_m: tuple[float, float, float]) -> float:
    """Returns the share of energy that walls absorb for a reverberation time, by Eyring's formula."""
    length, width, height = dims_m
    surface = 2 * (length * width + length * height + width * height)
    return float(1 - np.exp(-0.161 * length * width * height / (surface * rt60_s)))


def reverberant_lead(rt60_s: float) -> int:
    """Returns the duration of speech before a clip at a reverberation time, samples."""
    return max(LEAD_SAMPLES, round(LEAD_SHARE * rt60_s * SAMPLE_RATE))


def truncation_order(rt60_s: float) -> int:
    """Returns the highest rendered reflection order, ``ceil(60 RT60)``: 12 at 0.2 s, 24 at 0.4 s.

    In a room of 5 x 5 x 3 m this includes every reflection of the first 0.40 RT60 (24 dB of decay), and part of the
    later ones. The truncation was measured above 20 Hz on 30 random sources at 0.5 to 2.0 m, against full orders (27
    to 53, all reflections within RT60):

    - Missing energy of a response: 0.003 % at RT60 0.2 s, 0.02 % at 0.3 s and 0.03 % at 0.4 s. The worst case is
      0.042 %, or -34 dB, which is 14 dB below the noise of a scene.
    - Missing energy later than 50 ms after the direct sound: 0.3 to 0.6 %; later than RT60 / 2: about 30 %.
    - Reverberation times (T20): at most 2 % shorter.
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
    array_floor_m: tuple[float, float] | None = None,
    max_order: int | None = None,
) -> npt.NDArray[np.float32]:
    """Computes the responses from each source to each microphone of an array in a room.

    For free-field arrays the image method runs per microphone. For other arrays each reflection is a plane wave, see
    :mod:`avssl_pyro.simulation.acoustics.plane_waves`.

    Args:
        array: M microphones, or channels.
        sources_sx: positions of the sources, (S, 3), metres, in the array's coordinates (x forward, y left, z up).
        room_dims_m: length, width and height of the room, metres.
        height_m: height of the array's origin above the floor, metres.
        room_yaw: azimuth of the room's x axis in the array's coordinates, radians.
        rt60_s: reverberation time, seconds. Sabine's formula gives one absorption for all walls and frequencies.
        array_floor_m: place of the array along length and width, metres from a corner; None is the middle.
        max_order: highest reflection order, :func:`truncation_order` by default; 0 gives the direct path alone.

    Returns:
        Responses (S, M, L), float32, 16 kHz, zero-padded to the longest. All are late by half the length of the
        fractional delay filters (20 samples; for plane waves, half the length of the array's responses). Amplitudes
        are relative to a distance of one metre.

    Raises:
        InputError: the array has measured responses, or the room cannot have this reverberation time.
    """
    try:
        absorption, _ = pra.inverse_sabine(rt60_s, room_dims_m)
    except ValueError as error:
        raise InputError(
            f"a room of {' x '.join(f'{side:.1f}' for side in room_dims_m)} m cannot have an RT60 of {rt60_s:.2f} s by "
            "Sabine's formula; give a longer RT60 or a smaller room."
        ) from error
    order = truncation_order(rt60_s) if max_order is None else max_order
    room = pra.ShoeBox(room_dims_m, fs=SAMPLE_RATE, materials=pra.Material(absorption), max_order=order)
    room.set_sound_speed(array.speed_of_sound)
    acoustics = RoomAcoustics(room_dims_m, rt60_s, height_m, room_yaw, array_floor_m)
    centre, to_room = acoustics.array_position, acoustics.to_room
    is_open = array.steering == FreeFieldKind()
    room.add_microphone_array((array.positions @ to_room.T + centre).T if is_open else centre[:, None])
    for position in sources_sx @ to_room.T + centre:
        room.add_source(position)
    per_source = _at_points(room) if is_open else _at_receiver(room, plane_wave_receiver(array), centre, to_room)
    return padded_responses(per_source, array.num_microphones)


def padded_responses(per_source: Sequence[npt.NDArray[np.float32]], num_microphones: int) -> npt.NDArray[np.float32]:
    """Responses of S sources, (M, L) each, as (S, M, L), float32, zero-padded to the longest."""
    longest = max((response_ml.shape[1] for response_ml in per_source), default=0)
    responses_sml = np.zeros((len(per_source), num_microphones, longest), dtype=np.float32)
    for s, response_ml in enumerate(per_source):
        responses_sml[s, :, : response_ml.shape[1]] = response_ml
    return responses_sml


def sum_of_responses(first_ml: npt.NDArray[np.float32], second_ml: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """The sum of two responses (M, L), float32, as long as the longer."""
    both_sml = padded_responses((first_ml, second_ml), len(first_ml))
    summed_ml: npt.NDArray[np.float32] = both_sml[0] + both_sml[1]
    return summed_ml


def _at_points(room: pra.ShoeBox) -> list[npt.NDArray[np.float32]]:
    """Computes the responses (M, L) of each source, microphone by microphone."""
    with rendering_constants():
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
    """Computes the responses (M, L) of each source, reflection by reflection."""
    room.image_source_model()
    responses = []
    for source in room.sources:
        offset_kx = (source.images.T.astype(np.float64) - centre) @ to_room
        distance_k = np.linalg.norm(offset_kx, axis=-1)
        order_k = np.argsort(distance_k, kind="stable")
        offset_kx, distance_k, damping_k = offset_kx[order_k], distance_k[order_k], source.damping[0, order_k]
        waves = PlaneWaves(offset_kx / distance_k[:, None], distance_k / room.c, damping_k / distance_k)
        responses.append(receiver.responses(waves))
    return responses


# The next scene reuses the table of responses.
@lru_cache(maxsize=2)
def plane_wave_receiver(array: MicrophoneArray) -> PlaneWaveReceiver:
    """Returns the receiver of an array; its table of responses is computed once."""
    return PlaneWaveReceiver(array)


@contextmanager
def rendering_constants() -> Iterator[None]:
    """Sets pyroomacoustics' constants for rendering, and restores them."""
    # The constants are global to the process: one thread must not restore them while another renders.
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
    """Convolves a dry signal with each response and returns the last ``num_samples``, (M, num_samples), float32.

    The earlier part of ``dry_n`` provides the reverberation at the start of the clip. A zero-phase filter removes sound
    below 20 Hz.
    """
    length = fft.next_fast_len(len(dry_n) + responses_ml.shape[-1] - 1, real=True)
    frequencies_f = np.arange(length // 2 + 1, dtype=np.float32) * (SAMPLE_RATE / length)
    high_pass_f = frequencies_f**2 / (frequencies_f**2 + HIGH_PASS_HZ**2)
    spectrum_mf = fft.rfft(responses_ml, length) * (fft.rfft(dry_n, length) * high_pass_f)
    wet_mn: npt.NDArray[np.float32] = fft.irfft(spectrum_mf, length)[:, len(dry_n) - num_samples : len(dry_n)]
    return np.ascontiguousarray(wet_mn)

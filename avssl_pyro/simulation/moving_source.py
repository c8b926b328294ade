"""A voice that walks around the array: each short block goes through the room response of where its talker is then."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.simulation.reverberation import reverberate, room_responses

Audio = npt.NDArray[np.float32]


@dataclass(frozen=True)
class RoomAcoustics:
    """A room with an array over the middle of its floor.

    Args:
        dims_m: length, width and height.
        rt60_s: reverberation time.
        array_height_m: of the array's origin above the floor.
        room_yaw: azimuth of the room's own x axis seen from the array, radians.
    """

    dims_m: tuple[float, float, float] = (5.0, 5.0, 3.0)
    rt60_s: float = 0.2
    array_height_m: float = 1.5
    room_yaw: float = 0.0


@dataclass(frozen=True)
class Steps:
    """How finely a walk is rendered.

    Args:
        block_s: responses change so often, from one to the next by a linear cross-fade.
        cell_deg: azimuths are rounded to this, so that few responses have to be computed.
    """

    block_s: float = 0.2
    cell_deg: float = 2.0


def hear_walking(
    voice_n: Audio,
    azimuth_n: npt.NDArray[np.float64],
    distance_m: float,
    above_array_m: float,
    array: MicrophoneArray,
    room: RoomAcoustics,
    steps: Steps,
) -> Audio:
    """A voice at each microphone, (M, N), float32, brought to unit power at the array while it sounds.

    Args:
        voice_n: dry, 16 kHz; zeros where it pauses.
        azimuth_n: of the mouth at every sample, radians.
        distance_m, above_array_m: of the mouth from the array, along the floor and in height.
        array, room, steps: who hears it, where, and how finely it is rendered.
    """
    block = round(steps.block_s * SAMPLE_RATE)
    # Triangles of two blocks, one block apart, add up to one.
    fade_n = 1 - np.abs((np.arange(2 * block) + 0.5) / block - 1).astype(np.float32)
    padded_n = np.pad(voice_n, (block, 2 * block))
    starts = [
        start for start in range(-block, len(voice_n), block) if padded_n[start + block : start + 3 * block].any()
    ]
    heard_mn = np.zeros((array.num_microphones, len(voice_n)), dtype=np.float32)
    if not starts:
        return heard_mn
    middles_s = np.clip(np.array(starts) + block, 0, len(voice_n) - 1)
    cells = np.round(np.rad2deg(azimuth_n[middles_s]) / steps.cell_deg).astype(np.int64)
    distinct, which = np.unique(cells, return_inverse=True)
    angles = np.deg2rad(distinct * steps.cell_deg)
    responses_sml = room_responses(
        array,
        np.stack(
            [distance_m * np.cos(angles), distance_m * np.sin(angles), np.full_like(angles, above_array_m)], axis=-1
        ),
        room_dims_m=room.dims_m,
        height_m=room.array_height_m,
        room_yaw=room.room_yaw,
        rt60_s=room.rt60_s,
    )
    tail = responses_sml.shape[-1]
    whole_mn = np.zeros((array.num_microphones, len(padded_n) + tail), dtype=np.float32)
    for start, cell in zip(starts, which, strict=True):
        first = start + block
        dry_n = np.pad(padded_n[first : first + 2 * block] * fade_n, (0, tail))
        whole_mn[:, first : first + len(dry_n)] += reverberate(dry_n, responses_sml[cell], len(dry_n))
    heard_mn[:] = whole_mn[:, block : block + len(voice_n)]
    power = float(np.mean(np.square(heard_mn[:, np.abs(voice_n) > 0])))
    return heard_mn / np.float32(np.sqrt(power))


def with_noise(mixture_mn: Audio, snr_db: float, peak: float, rng: np.random.Generator) -> Audio:
    """The mixture with white noise of its own at each microphone, brought to a peak."""
    noise_std = np.sqrt(np.mean(np.square(mixture_mn, dtype=np.float64)) / 10 ** (snr_db / 10))
    noisy_mn = mixture_mn + np.float32(noise_std) * rng.standard_normal(mixture_mn.shape, dtype=np.float32)
    return noisy_mn * np.float32(peak / max(float(np.abs(noisy_mn).max()), 1e-10))

"""Sound of moving talkers in a room: each short block is convolved with the response of the talker's position."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.simulation.acoustics.reverberation import RoomAcoustics, reverberate, room_responses
from avssl_pyro.simulation.motion import MovingTalkers
from avssl_pyro.simulation.speech import SpeechSource
from avssl_pyro.simulation.synthetic.speech import ProceduralSpeech

# Largest modulus of a rendered recording.
PEAK = 0.5


@dataclass(frozen=True)
class MotionResolution:
    """Resolution in time and azimuth at which a trajectory is rendered.

    Args:
        block_s: duration of a block; a linear cross-fade joins the responses of neighbouring blocks.
        cell_deg: angle to which azimuths are rounded, which limits the number of responses.
    """

    block_s: float = 0.2
    cell_deg: float = 2.0


def render_moving_source(
    voice_n: npt.NDArray[np.float32],
    azimuth_n: npt.NDArray[np.float64],
    distance_m: float,
    above_array_m: float,
    array: MicrophoneArray,
    room: RoomAcoustics,
    resolution: MotionResolution,
) -> npt.NDArray[np.float32]:
    """Reverberant voice at each microphone, (M, N), float32, with unit power at the array while it sounds.

    Args:
        voice_n: dry voice, 16 kHz; zeros in its pauses.
        azimuth_n: azimuth of the mouth at every sample, radians.
        distance_m, above_array_m: distance of the mouth along the floor, and height above the array, metres.
        array: microphones.
        room: room around them.
        resolution: resolution of the trajectory.
    """
    block = round(resolution.block_s * SAMPLE_RATE)
    # Triangles of two blocks, one block apart, add up to one.
    fade_n = 1 - np.abs((np.arange(2 * block) + 0.5) / block - 1).astype(np.float32)
    padded_n = np.pad(voice_n, (block, 2 * block))
    starts = [
        start for start in range(-block, len(voice_n), block) if padded_n[start + block : start + 3 * block].any()
    ]
    wet_mn = np.zeros((array.num_microphones, len(voice_n)), dtype=np.float32)
    if not starts:
        return wet_mn
    middles_s = np.clip(np.array(starts) + block, 0, len(voice_n) - 1)
    cells = np.round(np.rad2deg(azimuth_n[middles_s]) / resolution.cell_deg).astype(np.int64)
    distinct, which = np.unique(cells, return_inverse=True)
    angles = np.deg2rad(distinct * resolution.cell_deg)
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
    wet_mn[:] = whole_mn[:, block : block + len(voice_n)]
    power = float(np.mean(np.square(wet_mn[:, np.abs(voice_n) > 0])))
    return wet_mn / np.float32(np.sqrt(power))


def add_noise(mixture_mn: npt.NDArray[np.float32], snr_db: float, rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """Adds white noise, independent between microphones, and scales the sum to a peak of 0.5."""
    noise_std = np.sqrt(np.mean(np.square(mixture_mn, dtype=np.float64)) / 10 ** (snr_db / 10))
    noisy_mn = mixture_mn + np.float32(noise_std) * rng.standard_normal(mixture_mn.shape, dtype=np.float32)
    return noisy_mn * np.float32(PEAK / max(float(np.abs(noisy_mn).max()), 1e-10))


@dataclass(frozen=True)
class MovingAudioConfig:
    """Room, voices and resolution of rendered talkers.

    Args:
        room_dims_m, rt60_s: room and its reverberation time; the array stands over the middle of the floor.
        height_m: height of the array and of all mouths.
        distance_m: least and greatest distance of a talker, which stays constant.
        snr_db: power of the mixture over that of the white noise.
        block_s, cell_deg: resolution of trajectories, see :class:`MotionResolution`.
        speech: source of the voices.
    """

    room_dims_m: tuple[float, float, float] = (5.0, 5.0, 3.0)
    rt60_s: float = 0.2
    height_m: float = 1.5
    distance_m: tuple[float, float] = (1.0, 2.0)
    snr_db: float = 20.0
    block_s: float = 0.2
    cell_deg: float = 2.0
    speech: SpeechSource = field(default_factory=ProceduralSpeech)


def render_moving_talkers(
    talkers: MovingTalkers, array: MicrophoneArray, config: MovingAudioConfig, rng: np.random.Generator
) -> npt.NDArray[np.float32]:
    """Recording of moving talkers, (M, N), float32, 16 kHz, with a peak of 0.5, as long as their trajectories."""
    step_s = float(talkers.times_s[1] - talkers.times_s[0])
    num_samples = round(len(talkers.times_s) * step_s * SAMPLE_RATE)
    room = RoomAcoustics(config.room_dims_m, config.rt60_s, config.height_m)
    resolution = MotionResolution(config.block_s, config.cell_deg)
    mixture_mn = np.zeros((array.num_microphones, num_samples), dtype=np.float32)
    instant_n = np.minimum((np.arange(num_samples) / (step_s * SAMPLE_RATE)).astype(int), len(talkers.times_s) - 1)
    for azimuth_t, sounding_t in zip(talkers.azimuths_st, talkers.sounding_st, strict=True):
        voice_n = config.speech.draw(rng, num_samples)
        voice_n = voice_n / max(float(np.sqrt(np.mean(np.square(voice_n)))), 1e-5)
        voice_n = (voice_n * sounding_t[instant_n]).astype(np.float32)
        distance_m = rng.uniform(*config.distance_m)
        mixture_mn += render_moving_source(voice_n, azimuth_t[instant_n], distance_m, 0.0, array, room, resolution)
    return add_noise(mixture_mn, config.snr_db, rng)

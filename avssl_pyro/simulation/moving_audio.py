"""The sound of talkers who walk: each short block of a voice through the room response of where its talker is then."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.data.clip import SAMPLE_RATE
from avssl_pyro.simulation.moving_talkers import MovingTalkers
from avssl_pyro.simulation.reverberation import reverberate, room_responses
from avssl_pyro.simulation.speech import SpeechSource
from avssl_pyro.simulation.voices import ProceduralSpeech

Audio = npt.NDArray[np.float32]


@dataclass(frozen=True)
class MovingAudioConfig:
    """Room and voices.

    Args:
        room_dims_m, rt60_s: the room; the array stands over the middle of its floor.
        height_m: of the array and of the mouths.
        distance_m: least and most distance of a talker, who stays at it.
        snr_db: of the mixture over white noise.
        block_s: responses change so often, from one to the next by a linear cross-fade.
        cell_deg: azimuths are rounded to this, so that few responses have to be computed.
        speech: the voices.
    """

    room_dims_m: tuple[float, float, float] = (5.0, 5.0, 3.0)
    rt60_s: float = 0.2
    height_m: float = 1.5
    distance_m: tuple[float, float] = (1.0, 2.0)
    snr_db: float = 20.0
    block_s: float = 0.2
    cell_deg: float = 2.0
    speech: SpeechSource = field(default_factory=ProceduralSpeech)


def render_moving(
    talkers: MovingTalkers, array: MicrophoneArray, config: MovingAudioConfig, rng: np.random.Generator
) -> Audio:
    """What the array hears, (M, N), float32, 16 kHz, with a peak of 0.5; it lasts as long as the talkers' instants."""
    step_s = float(talkers.times_s[1] - talkers.times_s[0])
    num_samples = round(len(talkers.times_s) * step_s * SAMPLE_RATE)
    mixture_mn = np.zeros((array.num_microphones, num_samples), dtype=np.float32)
    instant_n = np.minimum((np.arange(num_samples) / (step_s * SAMPLE_RATE)).astype(int), len(talkers.times_s) - 1)
    for azimuth_t, sounding_t in zip(talkers.azimuths_st, talkers.sounding_st, strict=True):
        voice_n = config.speech.draw(rng, num_samples)
        voice_n = voice_n / max(float(np.sqrt(np.mean(np.square(voice_n)))), 1e-5)
        voice_n = (voice_n * sounding_t[instant_n]).astype(np.float32)
        mixture_mn += _walk(voice_n, azimuth_t[instant_n], array, config, rng)
    noise_std = np.sqrt(np.mean(np.square(mixture_mn)) / 10 ** (config.snr_db / 10))
    mixture_mn += np.float32(noise_std) * rng.standard_normal(mixture_mn.shape, dtype=np.float32)
    return mixture_mn * np.float32(0.5 / max(float(np.abs(mixture_mn).max()), 1e-10))


def _walk(
    voice_n: Audio,
    azimuth_n: npt.NDArray[np.float64],
    array: MicrophoneArray,
    config: MovingAudioConfig,
    rng: np.random.Generator,
) -> Audio:
    """A voice at each microphone, (M, N), brought to unit power at the array."""
    block = round(config.block_s * SAMPLE_RATE)
    # Triangles of two blocks, one block apart, add up to one.
    fade_n = 1 - np.abs((np.arange(2 * block) + 0.5) / block - 1).astype(np.float32)
    starts = range(-block, len(voice_n), block)
    cells = np.array([_cell(azimuth_n[min(max(start + block, 0), len(voice_n) - 1)], config) for start in starts])
    distinct, which = np.unique(cells, return_inverse=True)
    angles = np.deg2rad(distinct * config.cell_deg)
    distance = rng.uniform(*config.distance_m)
    responses_sml = room_responses(
        array,
        distance * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1),
        room_dims_m=config.room_dims_m,
        height_m=config.height_m,
        room_yaw=0.0,
        rt60_s=config.rt60_s,
    )
    tail = responses_sml.shape[-1]
    padded_n = np.pad(voice_n, (block, 2 * block + tail))
    heard_mn = np.zeros((array.num_microphones, len(padded_n)), dtype=np.float32)
    for start, cell in zip(starts, which, strict=True):
        first = start + block
        dry_n = padded_n[first : first + 2 * block] * fade_n
        if dry_n.any():
            whole_n = np.pad(dry_n, (0, tail))
            heard_mn[:, first : first + len(whole_n)] += reverberate(whole_n, responses_sml[cell], len(whole_n))
    heard_mn = heard_mn[:, block : block + len(voice_n)]
    power = float(np.mean(np.square(heard_mn[:, np.abs(voice_n) > 0]))) if voice_n.any() else 1.0
    return heard_mn / np.float32(np.sqrt(power))


def _cell(azimuth: float, config: MovingAudioConfig) -> int:
    return round(float(np.rad2deg(azimuth)) / config.cell_deg)

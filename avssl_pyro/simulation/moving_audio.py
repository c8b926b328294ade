"""The sound of talkers who walk around an array, in a room."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.simulation.moving_source import RoomAcoustics, Steps, hear_walking, with_noise
from avssl_pyro.simulation.moving_talkers import MovingTalkers
from avssl_pyro.simulation.speech import SpeechSource
from avssl_pyro.simulation.synthetic_speech import ProceduralSpeech

Audio = npt.NDArray[np.float32]
PEAK = 0.5


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
    room = RoomAcoustics(config.room_dims_m, config.rt60_s, config.height_m)
    steps = Steps(config.block_s, config.cell_deg)
    mixture_mn = np.zeros((array.num_microphones, num_samples), dtype=np.float32)
    instant_n = np.minimum((np.arange(num_samples) / (step_s * SAMPLE_RATE)).astype(int), len(talkers.times_s) - 1)
    for azimuth_t, sounding_t in zip(talkers.azimuths_st, talkers.sounding_st, strict=True):
        voice_n = config.speech.draw(rng, num_samples)
        voice_n = voice_n / max(float(np.sqrt(np.mean(np.square(voice_n)))), 1e-5)
        voice_n = (voice_n * sounding_t[instant_n]).astype(np.float32)
        distance_m = rng.uniform(*config.distance_m)
        mixture_mn += hear_walking(voice_n, azimuth_t[instant_n], distance_m, 0.0, array, room, steps)
    return with_noise(mixture_mn, config.snr_db, PEAK, rng)

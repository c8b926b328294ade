"""Speech of the people of a recording: dry voices, their sound at an array, and their labels."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.io.dcase import FRAME_S, DcaseRow
from avssl_pyro.simulation.motion import MovingPeople
from avssl_pyro.simulation.moving_source import MotionResolution, render_moving_source
from avssl_pyro.simulation.speech import SpeechSource

FRAME_SAMPLES = round(FRAME_S * SAMPLE_RATE)
# A frame is active if a frame within this distance is at most AUDIBLE_DB below the loud frames of its turn. Pauses
# between words are thus active; silence around a sentence shorter than its turn is not.
NEAR_FRAMES = 2
AUDIBLE_DB = 30.0


@dataclass(frozen=True)
class DrySpeech:
    """Dry voices of S people and their activity; silent people have zeros.

    Args:
        voice_sn: voices, 16 kHz, (S, N).
        sounding_st: activity in frames of 100 ms, (S, T).
    """

    voice_sn: npt.NDArray[np.float32]
    sounding_st: npt.NDArray[np.bool_]


def draw_dialogue(people: MovingPeople, speech: SpeechSource, rng: np.random.Generator) -> DrySpeech:
    """Draws speech for all turns of all people; every turn gets another voice."""
    times_t = people.talkers.times_s
    step_s = float(times_t[1] - times_t[0])
    num_frames = round(len(times_t) * step_s / FRAME_S)
    voice_sn = np.zeros((len(people.distances_s), num_frames * FRAME_SAMPLES), dtype=np.float32)
    sounding_st = np.zeros((len(voice_sn), num_frames), dtype=bool)
    for s, turn_t in enumerate(people.talkers.sounding_st):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], turn_t, [False]]).astype(int)))
        for first, last in pairwise(np.round(edges * step_s / FRAME_S).astype(int).tolist()):
            if not turn_t[min(round(first * FRAME_S / step_s), len(turn_t) - 1)] or last == first:
                continue
            excerpt_n = speech.draw(rng, (last - first) * FRAME_SAMPLES)
            voice_sn[s, first * FRAME_SAMPLES : last * FRAME_SAMPLES] = excerpt_n
            sounding_st[s, first:last] = _audible(excerpt_n)
    return DrySpeech(voice_sn, sounding_st)


def _audible(excerpt_n: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    power_t = np.square(excerpt_n.astype(np.float64)).reshape(-1, FRAME_SAMPLES).mean(axis=1)
    loud_t = power_t > np.quantile(power_t, 0.95) * 10 ** (-AUDIBLE_DB / 10)
    return np.convolve(loud_t, np.ones(2 * NEAR_FRAMES + 1), mode="same")[: len(loud_t)] > 0


def render_dialogue(
    people: MovingPeople, voices: DrySpeech, array: MicrophoneArray, resolution: MotionResolution
) -> npt.NDArray[np.float32]:
    """Renders all voices in the room, (M, N), float32, 16 kHz, without noise."""
    num_samples = voices.voice_sn.shape[1]
    mixture_mn = np.zeros((array.num_microphones, num_samples), dtype=np.float32)
    azimuth_sn = people.azimuths_at(np.arange(num_samples, dtype=np.float64) / SAMPLE_RATE)
    for s, voice_n in enumerate(voices.voice_sn):
        distance_m, above_m = float(people.distances_s[s]), float(people.mouths_above_s[s])
        wet_mn = render_moving_source(voice_n, azimuth_sn[s], distance_m, above_m, array, people.room, resolution)
        mixture_mn += np.float32(10 ** (people.levels_s[s] / 20)) * wet_mn
    return mixture_mn


def dialogue_labels(people: MovingPeople, voices: DrySpeech) -> tuple[DcaseRow, ...]:
    """Returns the active talkers of every 100 ms frame, at their mouths' positions in its middle, as class 0."""
    middle_t = (np.arange(voices.sounding_st.shape[1], dtype=np.float64) + 0.5) * FRAME_S
    azimuth_st = np.rad2deg(people.azimuths_at(middle_t))
    elevation_s = np.rad2deg(people.elevations_s)
    reach_s = 100 * np.hypot(people.distances_s, people.mouths_above_s)
    return tuple(
        DcaseRow(int(t), 0, int(s), float(azimuth_st[s, t]), float(elevation_s[s]), round(float(reach_s[s])))
        for t, s in np.argwhere(voices.sounding_st.T)
    )

"""Checks of audio against video: their offset in time and their durations.

The offset is the lag at which onsets of sound and changes of the picture correlate best. Claps, doors, or somebody who
starts to move and talk give one clear peak. Seated talkers give none, and the offset then stays unknown.
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
import numpy.typing as npt

from avssl_pyro.diagnosis.finding import Finding, Severity

RATE = 50.0
LONGEST_S = 3.0
LEAST_SECONDS = 10.0
# A peak counts when it stands so many robust standard deviations above the other lags, this much above the next
# peak, and when each half of the recording has it in the same place.
LEAST_HEIGHT, LEAST_LEAD = 6.0, 1.3
SAME_PLACE_S = 0.06
TOLERATED_S = 0.08
# Audio and video whose durations differ more than this have lost a part or have a wrong rate in a header.
COMMON_RATES = (8_000, 16_000, 22_050, 24_000, 32_000, 44_100, 48_000, 96_000)
TOLERATED_SHARE, TOLERATED_DIFFERENCE_S = 0.02, 2.0
SAME_RATIO = 0.01


@dataclass(frozen=True)
class Lag:
    """Lag of the picture behind the sound.

    Args:
        lag_s: time in seconds from sound onsets to picture changes; negative if the picture is first.
        height: height of the correlation's peak in robust standard deviations.
        clear: whether the peak is significant.
    """

    lag_s: float
    height: float
    clear: bool


def sound_energy(audio_mn: npt.NDArray[np.float32], rate: int) -> npt.NDArray[np.float64]:
    """Mean power of all channels in steps of 1 / 50 s, (T,)."""
    step = round(rate / RATE)
    frames = audio_mn.shape[1] // step
    return np.asarray(
        np.square(audio_mn[:, : frames * step], dtype=np.float64).reshape(-1, frames, step).mean(axis=(0, 2))
    )


def picture_change(
    times_s: npt.NDArray[np.float64], images: npt.NDArray[np.uint8], duration_s: float
) -> npt.NDArray[np.float64]:
    """Mean square difference of following frames (I, rows, columns, ...), brought to steps of 1 / 50 s, (T,).

    A change belongs to the middle of its two frames' times.
    """
    frames = images.reshape(len(images), -1).astype(np.float32)
    change_i = np.square(np.diff(frames, axis=0)).mean(axis=1)
    middle_i = (times_s[1:] + times_s[:-1]) / 2
    grid_s = (np.arange(int(duration_s * RATE)) + 0.5) / RATE
    return np.interp(grid_s, middle_i, change_i)


def find_lag(energy_t: npt.NDArray[np.float64], change_t: npt.NDArray[np.float64]) -> Lag:
    """Correlates the onsets of two curves in steps of 1 / 50 s that start together."""
    length = min(len(energy_t), len(change_t))
    sound_t, picture_t = _onsets(energy_t[:length]), _onsets(change_t[:length])
    best, height, lead = _peak(sound_t, picture_t)
    half = length // 2
    halves = [_peak(sound_t[part], picture_t[part])[0] for part in (slice(half), slice(half, length))]
    agree = all(abs(lag - best) <= SAME_PLACE_S * RATE for lag in halves)
    long_enough = length >= LEAST_SECONDS * RATE
    clear = agree and long_enough and height >= LEAST_HEIGHT and lead >= LEAST_LEAD
    return Lag(best / RATE, height, clear)


def _onsets(power_t: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    floor = 1e-3 * max(float(power_t.mean()), 1e-12)
    rise_t = np.maximum(np.diff(np.log(power_t + floor), prepend=np.log(power_t[:1] + floor)), 0)
    smooth_t = np.convolve(rise_t, (0.25, 0.5, 0.25), mode="same")
    centred_t = smooth_t - smooth_t.mean()
    return np.asarray(centred_t / max(float(np.linalg.norm(centred_t)), 1e-12))


def _peak(sound_t: npt.NDArray[np.float64], picture_t: npt.NDArray[np.float64]) -> tuple[int, float, float]:
    """The best lag in steps, its height, and its lead over the next peak."""
    longest = min(int(LONGEST_S * RATE), len(sound_t) // 3)
    middle = len(sound_t) - 1
    correlation_l = np.correlate(picture_t, sound_t, mode="full")[middle - longest : middle + longest + 1]
    best = int(correlation_l.argmax())
    spread = 1.4826 * float(np.median(np.abs(correlation_l - np.median(correlation_l))))
    heights_l = (correlation_l - np.median(correlation_l)) / max(spread, 1e-12)
    # The picture is sampled coarsely, so that a peak is a few steps wide.
    elsewhere_l = np.abs(np.arange(len(correlation_l)) - best) > 6
    runner_up = max(float(heights_l[elsewhere_l].max(initial=0.0)), 1e-12)
    return best - longest, float(heights_l[best]), float(heights_l[best]) / runner_up


def check_lag(
    energy_t: npt.NDArray[np.float64], change_t: npt.NDArray[np.float64], given_s: float = 0.0
) -> tuple[Finding, ...]:
    """Checks the offset between sound and picture.

    Args:
        energy_t, change_t: curves of sound and picture, from :func:`sound_energy` and :func:`picture_change`.
        given_s: offset in seconds (audio minus video time) that was already applied.
    """
    lag = find_lag(energy_t, change_t)
    if not lag.clear:
        found = "the delay between sound and picture is undetermined: they have no clear onsets in common"
        return (
            Finding(
                "audio-video offset", Severity.NOTE, found, 0.5, "clap three times in view of the camera to be sure"
            ),
        )
    confidence = float(1 - np.exp(-lag.height / 3))
    if abs(lag.lag_s) <= TOLERATED_S:
        return (Finding("audio-video offset", Severity.OK, "sound and picture are in step", confidence),)
    side = "after" if lag.lag_s > 0 else "before"
    found = f"the picture comes {abs(lag.lag_s):.2f} s {side} the sound"
    return (
        Finding(
            "audio-video offset",
            Severity.WARNING,
            found,
            confidence,
            f"read it with an offset of {given_s - lag.lag_s:+.2f} s",
        ),
    )


def check_durations(audio_s: float, rate: int, video_s: float) -> tuple[Finding, ...]:
    """Compares the durations of audio (by its header's sample rate) and video."""
    if abs(audio_s - video_s) <= max(TOLERATED_DIFFERENCE_S, TOLERATED_SHARE * video_s):
        return (Finding("durations", Severity.OK, "audio and video last about equally long", 1.0),)
    found = f"the audio lasts {audio_s:.1f} s, the video {video_s:.1f} s"
    for claimed, true in permutations(COMMON_RATES, 2):
        if claimed == rate and abs(audio_s / video_s * claimed / true - 1) < SAME_RATIO:
            slip = f"{found}: as if audio of {true} Hz were said to have {rate} Hz"
            return (
                Finding("durations", Severity.WARNING, slip, 0.8, f"set the sample rate in its header to {true} Hz"),
            )
    return (
        Finding(
            "durations", Severity.NOTE, found, 1.0, "only what both cover is used; give an offset if one starts late"
        ),
    )

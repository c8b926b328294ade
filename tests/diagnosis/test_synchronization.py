"""Flashes and claps, by which sound and picture can be compared."""

import numpy as np
import numpy.typing as npt
import pytest

from avssl_pyro.diagnosis.finding import Severity
from avssl_pyro.diagnosis.synchronization import check_durations, check_lag, find_lag, picture_change, sound_energy

RATE, SECONDS = 16_000, 24.0


def claps(rng: np.random.Generator) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float32]]:
    """Moments, and the sound of short bursts at them."""
    moments_s = np.sort(rng.uniform(3, SECONDS - 3, 14))
    audio_n = 0.005 * rng.standard_normal(int(SECONDS * RATE))
    for moment_s in moments_s:
        start = int(moment_s * RATE)
        audio_n[start : start + 800] += 0.5 * rng.standard_normal(800) * np.exp(-np.arange(800) / 200)
    return moments_s, np.stack([audio_n, audio_n]).astype(np.float32)


def film(
    moments_s: npt.NDArray[np.float64], rng: np.random.Generator
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint8]]:
    """Frames at an uneven 25 per second in which something moves for a tenth of a second from each moment on."""
    times_s = np.cumsum(rng.uniform(0.03, 0.05, 700))
    times_s = times_s[times_s < SECONDS]
    images = rng.integers(100, 104, (len(times_s), 12, 24)).astype(np.uint8)
    for moment_s in moments_s:
        for frame in np.flatnonzero((times_s >= moment_s) & (times_s < moment_s + 0.1)):
            images[frame, 3:9, 4:12] = rng.integers(0, 255)
    return times_s, images


@pytest.mark.parametrize("late_s", [0.0, 0.4, -1.1])
def test_the_offset_of_claps_is_found(late_s: float) -> None:
    rng = np.random.default_rng(3)
    moments_s, audio_mn = claps(rng)
    energy_t = sound_energy(audio_mn, RATE)
    change_t = picture_change(*film(moments_s + late_s, rng), SECONDS)
    lag = find_lag(energy_t, change_t)
    assert lag.clear
    assert lag.lag_s == pytest.approx(late_s, abs=0.06)
    (finding,) = check_lag(energy_t, change_t)
    assert finding.severity == (Severity.OK if late_s == 0 else Severity.WARNING)


@pytest.mark.parametrize("seed", range(8))
def test_where_nothing_happens_together_nothing_is_claimed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    _, audio_mn = claps(rng)
    others_s, _ = claps(rng)
    (finding,) = check_lag(sound_energy(audio_mn, RATE), picture_change(*film(others_s, rng), SECONDS))
    assert finding.severity == Severity.NOTE
    assert "undetermined" in finding.message


def test_a_still_picture_says_nothing() -> None:
    rng = np.random.default_rng(0)
    _, audio_mn = claps(rng)
    times_s = np.arange(0, SECONDS, 0.04)
    still = np.full((len(times_s), 12, 24), 90, np.uint8)
    (finding,) = check_lag(sound_energy(audio_mn, RATE), picture_change(times_s, still, SECONDS))
    assert "undetermined" in finding.message


def test_durations_give_a_wrong_rate_away() -> None:
    assert check_durations(60.0, 16_000, 60.9)[0].severity == Severity.OK
    (slip,) = check_durations(180.0 * 44_100 / 48_000, 48_000, 180.0)
    assert slip.severity == Severity.WARNING
    assert "audio of 44100 Hz were said to have 48000 Hz" in slip.message
    assert check_durations(120.0, 16_000, 180.0)[0].severity == Severity.NOTE

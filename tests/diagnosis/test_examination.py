"""A good recording passes; broken in one way, it is told in which."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.compatibility import matching_channels
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.diagnosis.examination import examine
from avssl_pyro.diagnosis.finding import Finding, Severity
from avssl_pyro.diagnosis.repairs import advance, scaled
from avssl_pyro.errors import InputError
from avssl_pyro.recordings.excerpts import Excerpts
from avssl_pyro.simulation.scenes import SceneSimulator

NUM_CLIPS = 5
TETRA = MicrophoneArray("tetra", ((0.04, 0.04, 0.04), (0.04, -0.04, -0.04), (-0.04, 0.04, -0.04), (-0.04, -0.04, 0.04)))
ARRAYS = {**{name: PRESETS[name] for name in ("circle2", "circle4", "circle6")}, "tetra": TETRA}

Good = Mapping[tuple[str, int], Excerpts]
Raw = npt.NDArray[np.float32]
CIRCLE6 = ARRAYS["circle6"]


@pytest.fixture(scope="module")
def good(scene_folder: Path) -> Good:
    """Excerpts by array and by which of two recordings they are from."""
    recordings = {}
    for name in ("circle2", "circle4", "circle6"):
        dataset = SceneDataset(scene_folder, PRESETS[name])
        for number in range(2):
            clips = [dataset[number * NUM_CLIPS + index] for index in range(NUM_CLIPS)]
            recordings[name, number] = Excerpts.of_clips(clips)
    for number in range(2):
        simulator = SceneSimulator(seed=90 + number, array=TETRA)
        recordings["tetra", number] = Excerpts.of_clips([simulator.render(index).clip for index in range(3)])
    return recordings


def complaints(findings: tuple[Finding, ...]) -> list[Finding]:
    return [finding for finding in findings if finding.severity >= Severity.WARNING]


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("name", ARRAYS)
def test_a_good_recording_passes(name: str, number: int, good: Good) -> None:
    findings = examine(good[name, number], ARRAYS[name])
    assert complaints(findings) == []
    assert {"geometry", "levels", "clipping", "duplicates", "array"} <= {finding.check for finding in findings}


def dead(raw_bmn: Raw) -> None:
    raw_bmn[:, 2] = 0


def faint(raw_bmn: Raw) -> None:
    raw_bmn[:, 2] *= 1e-3


def loud(raw_bmn: Raw) -> None:
    raw_bmn[:, 2] *= 4
    raw_bmn /= 4


def offset(raw_bmn: Raw) -> None:
    raw_bmn[:, 2] += 0.1


def interrupted(raw_bmn: Raw) -> None:
    raw_bmn[1, 2] = 0


def clipped(raw_bmn: Raw) -> None:
    top = 0.4 * np.abs(raw_bmn[:, 2]).max()
    raw_bmn[:, 2] = raw_bmn[:, 2].clip(-top, top)


def copied(raw_bmn: Raw) -> None:
    raw_bmn[:, 4] = -0.7 * raw_bmn[:, 2]


def exchanged(raw_bmn: Raw) -> None:
    raw_bmn[:, [0, 1]] = raw_bmn[:, [1, 0]]


def inverted(raw_bmn: Raw) -> None:
    raw_bmn[:, 2] *= -1


def a_little_late(raw_bmn: Raw) -> None:
    raw_bmn[:, 2] = advance(raw_bmn[:, 2], -2 / 16000)


def very_late(raw_bmn: Raw) -> None:
    raw_bmn[:, 2] = advance(raw_bmn[:, 2], -800 / 16000)


def two_devices(raw_bmn: Raw) -> None:
    raw_bmn[:, 4:] = advance(raw_bmn[:, 4:], -320 / 16000)


def replaced_by_noise(raw_bmn: Raw) -> None:
    noise_bn = np.random.default_rng(0).standard_normal(raw_bmn[:, 2].shape)
    raw_bmn[:, 2] = noise_bn * raw_bmn[:, 3].std()


@pytest.mark.parametrize(
    ("damage", "check", "says"),
    [
        (dead, "levels", "channel 3 is dead: constant throughout"),
        (faint, "levels", "dB below the others"),
        (loud, "levels", "channel 3 is 12 dB louder than the others"),
        (offset, "levels", "channel 3 carries direct current: its mean is +0.1000"),
        (interrupted, "levels", "channel 3 drops out: constant in 20% of the excerpts"),
        (clipped, "clipping", "channel 3 is clipped"),
        (copied, "duplicates", "channels 3 and 5 are copies of one signal"),
        (exchanged, "channel order", "channels 1 and 2 are exchanged"),
        (inverted, "polarity", "channel 3 is inverted"),
        (a_little_late, "delays", "channel 3 comes 0.1"),
        (very_late, "delays", "channel 3 comes 50.0"),
        (two_devices, "delays", "channels 5 and 6 come"),
        (replaced_by_noise, "array", "channel 3 has another sound than the other channels"),
    ],
)
def test_damage_is_named_and_nothing_else(damage: Callable[[Raw], None], check: str, says: str, good: Good) -> None:
    raw_bmn = good["circle6", 0].raw_bmn.copy()
    damage(raw_bmn)
    (finding,) = complaints(examine(Excerpts.of_blocks(raw_bmn, 16_000), CIRCLE6))
    assert finding.check == check
    assert says in finding.message
    assert finding.advice
    assert finding.confidence > 0.7


@pytest.mark.parametrize(
    ("factor", "says"), [(2.0, "too large (radius for diameter?)"), (0.1, "too small (mm for cm?)")]
)
def test_wrong_units_are_named(factor: float, says: str, good: Good) -> None:
    (finding,) = complaints(examine(good["circle6", 0], scaled(CIRCLE6, factor)))
    assert finding.check == "units"
    assert says in finding.message


def test_a_wrong_sample_rate_looks_like_wrong_units(good: Good) -> None:
    claimed = Excerpts.of_blocks(good["circle6", 0].raw_bmn, 48_000)
    assert "about 3" in next(iter(complaints(examine(claimed, CIRCLE6)))).message


def test_what_only_mirrors_the_array_is_not_claimed(good: Good) -> None:
    exchanged_bmn = good["circle4", 0].raw_bmn[:, [2, 1, 0, 3]]
    findings = examine(Excerpts.of_blocks(exchanged_bmn, 16_000), ARRAYS["circle4"])
    assert complaints(findings) == []
    assert any("an exchange of channels 1-3 and 2-4 only mirrors the array" in finding.message for finding in findings)


def test_exchanges_that_sound_alike_are_named_together(good: Good) -> None:
    exchanged_bmn = good["circle4", 0].raw_bmn[:, [1, 0, 2, 3]]
    (finding,) = complaints(examine(Excerpts.of_blocks(exchanged_bmn, 16_000), ARRAYS["circle4"]))
    assert "channels 1 and 2, or channels 3 and 4 are exchanged" in finding.message


def test_channels_keep_their_numbers_when_others_are_left_out(good: Good) -> None:
    raw_bmn = good["circle6", 0].raw_bmn.copy()
    dead(raw_bmn[:, 0:3])
    raw_bmn[:, 4] *= -1
    found = {
        finding.check: finding.message for finding in complaints(examine(Excerpts.of_blocks(raw_bmn, 16_000), CIRCLE6))
    }
    assert found.keys() == {"levels", "polarity"}
    assert "channel 5 is inverted" in found["polarity"]


def test_channels_have_the_numbers_of_the_file(scene_folder: Path) -> None:
    union = SceneDataset(scene_folder)
    raw_bmn = np.stack([union[index].audio_mn for index in range(3)])
    raw_bmn[:, 3] = 0
    of_circle6 = matching_channels(union.array, CIRCLE6, where="")
    findings = examine(Excerpts.of_blocks(raw_bmn, 16_000).select(of_circle6), CIRCLE6)
    assert [finding.message for finding in complaints(findings)] == ["channel 4 is dead: constant throughout"]


def on_a_sphere(array: MicrophoneArray) -> Excerpts:
    """Two sources of sparse noise at a time, as an array hears them by its own steering, and a little noise."""
    rng, length = np.random.default_rng(8), 16_000
    steering_fdm = array.steering_vectors(DirectionGrid(8), np.fft.rfftfreq(length, 1 / 16_000)).numpy()
    raw_bmn = 1e-3 * rng.standard_normal((3, array.num_microphones, length))
    for number in range(len(raw_bmn)):
        for direction in rng.permutation(8)[:2]:
            envelope_n = np.repeat(rng.uniform(0, 1, 40) ** 3, length // 40)
            spectrum_f = np.fft.rfft(0.1 * envelope_n * rng.standard_normal(length))
            raw_bmn[number] += np.fft.irfft(spectrum_f * steering_fdm[:, direction].T, length)
    return Excerpts.of_blocks(raw_bmn.astype(np.float32), 16_000)


def test_an_array_on_a_sphere_is_judged_by_its_own_response() -> None:
    array = PRESETS["starss23-mic"]
    excerpts = on_a_sphere(array)
    assert complaints(examine(excerpts, array)) == []
    late_bmn = excerpts.raw_bmn.copy()
    late_bmn[:, 1] = advance(late_bmn[:, 1], -3 / 16000)
    (finding,) = complaints(examine(Excerpts.of_blocks(late_bmn, 16_000), array))
    assert "channel 2 comes 0.1" in finding.message


def test_nothing_is_claimed_of_ambisonics() -> None:
    array = PRESETS["starss23-foa"]
    raw_bmn = 0.1 * np.random.default_rng(0).standard_normal((2, 4, 16_000))
    findings = examine(Excerpts.of_blocks(raw_bmn.astype(np.float32), 16_000), array)
    assert complaints(findings) == []
    assert any("cannot be checked on an array" in finding.message for finding in findings)


def test_silence_is_an_error() -> None:
    silence = Excerpts.of_blocks(np.zeros((2, 6, 16_000), np.float32), 16_000)
    (finding,) = complaints(examine(silence, CIRCLE6))
    assert "the recording is silent" in finding.message


def test_another_number_of_channels_is_refused(good: Good) -> None:
    other: MicrophoneArray = ARRAYS["circle4"]
    with pytest.raises(InputError, match=r"6 channel\(s\), but array 'circle4' has 4"):
        examine(good["circle6", 0], other)

from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import soundfile
from measured_room import RATE, response, write_room, write_speech

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.benchmarks.rooms.clips import (
    NOBODY,
    ONE_TALKER,
    PINK,
    SILENCE,
    TWO_TALKERS,
    WHITE,
    RoomClips,
    write_clips,
)
from avssl_pyro.benchmarks.rooms.responses import RoomResponse, read_responses
from avssl_pyro.errors import InputError
from avssl_pyro.simulation.speech import SpeechFolder

ARRAY = PRESETS["circle4"]
AZIMUTHS_DEG = (0, 10, 90, 135, 180, -90, -45, -10)


@pytest.fixture(scope="module")
def speech(tmp_path_factory: pytest.TempPathFactory) -> SpeechFolder:
    return SpeechFolder(write_speech(tmp_path_factory.mktemp("speech")))


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory, speech: SpeechFolder) -> RoomClips:
    responses = read_responses(write_room(tmp_path_factory.mktemp("room"), ARRAY, AZIMUTHS_DEG), ARRAY)
    return RoomClips(responses, speech, ARRAY.num_microphones, seed=3)


def made_up(name: str, azimuth_deg: float, samples_mn: np.ndarray, setting: str = "hall") -> RoomResponse:
    channels = tuple(range(len(samples_mn)))
    return RoomResponse(name, name, setting, np.deg2rad(azimuth_deg), None, samples_mn.astype(np.float32), channels)


def test_clips_are_one_second_of_every_kind(source: RoomClips) -> None:
    clips = source.draw_all(2, 3, 7)
    counts = Counter(made.kind for made in clips)
    assert counts == {ONE_TALKER: 2, TWO_TALKERS: 3, WHITE: 3, PINK: 2, SILENCE: 2}
    assert len({made.clip.key for made in clips}) == 12
    for made in clips:
        assert made.clip.audio_mn.shape == (4, RATE)
        assert np.isfinite(made.clip.audio_mn).all()
        assert len(made.azimuths) == {ONE_TALKER: 1, TWO_TALKERS: 2}.get(made.kind, 0)
        assert np.abs(made.clip.audio_mn).max() <= 0.51


def test_a_clip_depends_on_the_seed_and_not_on_other_clips(source: RoomClips) -> None:
    one, other = source.draw_all(1, 2, 3), source.draw_all(3, 2, 3)
    audio = {made.clip.key: made.clip.audio_mn for made in other}
    assert all(np.array_equal(made.clip.audio_mn, audio[made.clip.key]) for made in one)
    changed = replace(source, seed=4).draw_all(1, 2, 3)
    same = [np.array_equal(a.clip.audio_mn, b.clip.audio_mn) for a, b in zip(one, changed, strict=True)]
    assert same == [False] * 5 + [True]


def test_single_talkers_use_every_response_before_any_comes_again(source: RoomClips) -> None:
    names = [source.draw(ONE_TALKER, index).responses[0].name for index in range(16)]
    assert set(Counter(names[:8]).values()) == set(Counter(names[8:]).values()) == {1}
    assert names[:8] != names[8:]


def test_two_talkers_share_a_setting_and_are_apart(source: RoomClips) -> None:
    halves = tuple(replace(each, setting="a" if number % 2 else "b") for number, each in enumerate(source.responses))
    for index in range(20):
        one, other = replace(source, responses=halves).draw(TWO_TALKERS, index).responses
        assert one.setting == other.setting
        assert abs(np.angle(np.exp(1j * (one.azimuth - other.azimuth)))) >= np.deg2rad(20) - 1e-9


def test_levels_of_talkers_and_noise_are_those_stated(speech: SpeechFolder) -> None:
    # Each is loud at a microphone of its own, so that the mixture shows both levels.
    decay_n = 0.5 ** np.arange(2000)
    loud, faint = np.array([1, 1e-4])[:, None] * decay_n, np.array([1e-4, 1])[:, None] * decay_n
    source = RoomClips((made_up("a", 0, loud), made_up("b", 90, faint)), speech, 2)
    differences_db = []
    for index in range(12):
        made = source.draw(TWO_TALKERS, index)
        power_m = made.clip.audio_mn.astype(float).var(axis=1)
        first = 0 if made.responses[0].name == "a" else 1
        differences_db.append(10 * np.log10(power_m[first] / power_m[1 - first]))
    assert min(differences_db) > -0.3
    assert max(differences_db) < 5.3
    assert np.ptp(differences_db) > 1
    for index in range(4):
        made = source.draw(ONE_TALKER, index)
        power_m = np.sort(made.clip.audio_mn.astype(float).var(axis=1))
        # The noise has the same level in both, below the mean power of the two.
        assert 24.8 < 10 * np.log10(power_m.mean() / power_m[0]) < 30.2


def test_nobody_is_white_diffuse_or_silent(source: RoomClips) -> None:
    white, pink, silence = (source.draw(kind, 0).clip.audio_mn for kind in NOBODY)
    assert not silence.any()
    assert np.abs(np.corrcoef(white) - np.eye(4)).max() < 0.05
    power_f = (np.abs(np.fft.rfft(pink)) ** 2).mean(axis=0)
    octaves = [power_f[low : 2 * low].mean() for low in (250, 1000, 4000)]
    # Pink noise falls by 3 dB an octave, through responses whose noise is white.
    for high, low in pairwise(octaves):
        assert 3.5 < 10 * np.log10(high / low) < 8.5


def test_diffuse_noise_has_no_direct_sound(speech: SpeechFolder) -> None:
    """The direct sound alone would be the same at both microphones; the late parts here are not."""
    rng = np.random.default_rng(0)
    samples_mn = np.zeros((2, 4000))
    samples_mn[:, 100] = 1.0
    late_mn = np.concatenate([np.zeros((2, 1000)), 0.01 * rng.standard_normal((2, 3000))], axis=1)
    responses = tuple(made_up(str(number), 40 * number, samples_mn + late_mn) for number in range(8))
    audio_mn = RoomClips(responses, speech, 2).draw(PINK, 0).clip.audio_mn
    assert abs(np.corrcoef(audio_mn)[0, 1]) < 0.3


@pytest.mark.parametrize(
    ("azimuths_deg", "kind", "says"),
    [
        ((0, 10), TWO_TALKERS, "no setting has two directions at least 20 degrees apart for two talkers"),
        ((0, 90), PINK, "no setting has 8 responses for diffuse noise"),
    ],
)
def test_too_few_responses_are_named(azimuths_deg: tuple[int, ...], kind: str, says: str, speech: SpeechFolder) -> None:
    responses = tuple(made_up(str(degrees), degrees, response(ARRAY, degrees).T) for degrees in azimuths_deg)
    with pytest.raises(InputError, match=says):
        RoomClips(responses, speech, 4).draw(kind, 0)


def test_speech_that_is_over_before_the_clip_begins_is_named(source: RoomClips, tmp_path: Path) -> None:
    click_n = np.zeros(3 * RATE)
    click_n[5] = 0.5
    soundfile.write(tmp_path / "click.wav", click_n, RATE)
    with pytest.raises(InputError, match=r"click\.wav: "):
        replace(source, speech=SpeechFolder(tmp_path)).draw(ONE_TALKER, 0)


def test_written_clips_are_those_drawn(source: RoomClips, tmp_path: Path) -> None:
    clips = source.draw_all(1, 1, 1)
    write_clips(tmp_path, clips, replace(ARRAY, channels=(2, 3, 4, 5)))
    lines = (tmp_path / "clips.csv").read_text().splitlines()
    assert lines[0] == "audio,azimuth_deg,kind"
    for line, made in zip(lines[1:], clips, strict=True):
        name, azimuths_deg, kind = line.split(",")
        audio_nm, rate = soundfile.read(tmp_path / name, dtype="float32")
        assert rate == RATE
        assert np.array_equal(audio_nm.T, made.clip.audio_mn)
        assert [float(word) for word in azimuths_deg.split()] == pytest.approx(np.rad2deg(made.azimuths), abs=0.01)
        assert kind == made.kind
    assert "channels" not in (tmp_path / "array.yaml").read_text()

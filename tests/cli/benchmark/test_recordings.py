import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import soundfile

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.cli.benchmark.recordings import recordings
from avssl_pyro.clip import SAMPLE_RATE

ARRAY = PRESETS["circle4"]
BASELINES = ("srp-phat", "music", "norm-music")
METHODS = ("audio-only refined", *(f"{name}{how}" for name in BASELINES for how in ("", ", tuned")))


def record(path, azimuths_deg, seconds):
    """Noise of talkers far away, each silent for a third of the time, in weaker noise of every microphone."""
    rng = np.random.default_rng(len(azimuths_deg))
    samples = int(seconds * SAMPLE_RATE)
    frequencies = np.fft.rfftfreq(samples, 1 / SAMPLE_RATE)
    audio_mn = 0.03 * rng.standard_normal((ARRAY.num_microphones, samples))
    for number, azimuth in enumerate(np.deg2rad(azimuths_deg)):
        voice_n = rng.standard_normal(samples)
        voice_n[number * samples // 3 : (number + 1) * samples // 3] = 0
        lead_m = ARRAY.positions @ [np.cos(azimuth), np.sin(azimuth), 0.0] / ARRAY.speed_of_sound
        shift_mf = np.exp(2j * np.pi * frequencies * lead_m[:, None])
        audio_mn += np.fft.irfft(np.fft.rfft(voice_n) * shift_mf, samples)
    soundfile.write(path, 0.1 * audio_mn.T, SAMPLE_RATE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    record(folder / "one.wav", [180], 0.9)
    record(folder / "two.flac", [-90, 30], 1.2)
    (folder / "labels.csv").write_text("file,room,azimuth_deg\none.wav,hall,180\ntwo.flac,hall,270 30\n")
    return folder


def lines_of(printed: str, title: str) -> dict[str, str]:
    """Lines of the table with that title by method."""
    table = printed.partition(title)[2].partition("\n\n")[0]
    lines = [line.strip() for line in table.splitlines()]
    return {method: line.removeprefix(method) for line in lines for method in METHODS if line.startswith(f"{method} ")}


def test_finds_talkers_that_pause_and_counts_what_is_found(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recordings(["--recordings", str(folder), "--array", "circle4", "--verbose"])
    printed = capsys.readouterr().out
    one, two = lines_of(printed, "1 talker: 1 recording"), lines_of(printed, "2 talkers: 1 recording")
    assert tuple(one) == tuple(two) == METHODS
    for lines, labelled in ((one, 1), (two, 2)):
        for method in ("audio-only refined", "norm-music, tuned"):
            words = lines[method].split()
            assert words[:7] == f"{labelled} of {labelled} {labelled} of {labelled} 0".split(), method
            assert words[8:] == ["1", "of", "1"]
    [each] = [line for line in printed.splitlines() if line.startswith("two.flac:")]
    assert each == "two.flac: 30 270"
    assert "tuned on" not in printed and "on these very files" in printed


def test_fewer_classes_than_talkers_miss_some(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recordings(["--recordings", str(folder), "--array", "circle4", "--num-classes", "1", "--rounds", "5"])
    words = lines_of(capsys.readouterr().out, "2 talkers: 1 recording")["audio-only refined"].split()
    assert int(words[3]) < 2 and words[-3:] == ["0", "of", "1"]


def test_the_example_of_the_page_is_understood(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (Path(__file__).parents[3] / "docs" / "recordings.md").read_text(encoding="utf-8")
    [example] = re.findall(r"```\n(file,azimuth_deg\n.*?)```", page, re.DOTALL)
    (tmp_path / "labels.csv").write_text(example)
    for name in ("one.wav", "two.flac"):
        (tmp_path / name).symlink_to(folder / name)
    [command] = re.findall(r"^avssl benchmark recordings(.*)$", page, re.MULTILINE)
    recordings([*shlex.split(command.replace("FOLDER", shlex.quote(str(tmp_path)))), "--rounds", "2"])
    assert "2 talkers: 1 recording" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("level_m", "says"),
    [
        ([0.0, 0.0, 0.0, 0.0], "mute.wav: is silent throughout, but its labels name somebody who talks"),
        ([0.1, 0.0, 0.1, 0.0], "mute.wav: channel 2, 4 is dead, constant throughout"),
    ],
)
def test_a_recording_in_which_nothing_can_be_heard_is_named(level_m, says, tmp_path, refusal):
    noise_nm = np.random.default_rng(0).standard_normal((SAMPLE_RATE // 2, 4))
    soundfile.write(tmp_path / "mute.wav", level_m * noise_nm, SAMPLE_RATE)
    (tmp_path / "labels.csv").write_text("file,azimuth_deg\nmute.wav,30\n")
    assert says in refusal(lambda: recordings(["--recordings", str(tmp_path), "--array", "circle4"]))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--num-classes", "0"], "--num-classes 0 --rounds 40: give at least one class and one round."),
        (["--pause-db", "-3"], "--pause-db -3.0: give a positive number of decibels."),
        (["--peaks.threshold", "2"], "--peaks.threshold 2.0 --peaks.most 4: give a height from 0 to 1"),
        (["--array", "circle6"], "one.wav: 4 channel(s), but array 'circle6' has 6 microphones"),
    ],
)
def test_what_cannot_be_compared_is_refused(options, says, folder, refusal):
    assert says in refusal(lambda: recordings(["--recordings", str(folder), "--array", "circle4", *options]))

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile
from measured_room import RATE, response, write_room

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.benchmarks.rooms.responses import direct_sound, read_responses
from avssl_pyro.errors import InputError

ARRAY = PRESETS["circle4"]


def refused(folder: Path, array: MicrophoneArray = ARRAY) -> str:
    with pytest.raises(InputError) as error_info:
        for read in read_responses(folder, array):
            read.impulse_mn()
    assert str(error_info.value).startswith(str(folder))
    return str(error_info.value)


def labels(folder: Path, *lines: str, first: str = "file,azimuth_deg") -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "labels.csv").write_text("\n".join([first, *lines]) + "\n")
    return folder


def test_responses_of_any_format_and_rate_begin_before_the_direct_sound(tmp_path: Path) -> None:
    azimuths_deg = [0, 90, 190, -90, 45, 135]
    responses = read_responses(write_room(tmp_path, ARRAY, azimuths_deg), ARRAY)
    assert [round(float(np.rad2deg(each.azimuth))) % 360 for each in responses] == [0, 90, 190, 270, 45, 135]
    assert {each.setting for each in responses} == {"hall"}
    for azimuth_deg, each in zip(azimuths_deg, responses, strict=True):
        impulse_mn = each.impulse_mn()
        assert direct_sound(impulse_mn) == RATE // 200
        # The microphone towards the loudspeaker is the first, by up to 20 cm of the sound's way.
        lead_m = ARRAY.positions @ [np.cos(np.deg2rad(azimuth_deg)), np.sin(np.deg2rad(azimuth_deg)), 0.0]
        peak_m = np.abs(impulse_mn).argmax(axis=1)
        assert np.abs(peak_m - peak_m.min() - (lead_m.max() - lead_m) / 343 * RATE).max() <= 1.5


def test_late_parts_begin_30_ms_after_the_direct_sound(tmp_path: Path) -> None:
    (read,) = read_responses(write_room(tmp_path, ARRAY, [30]), ARRAY)
    whole_mn, late_mn = read.impulse_mn(), read.late_mn()
    begin = direct_sound(whole_mn) + 480
    assert not late_mn[:, :begin].any()
    assert np.array_equal(late_mn[:, begin:], whole_mn[:, begin:])
    assert late_mn.any()


def test_a_response_without_a_room_has_no_late_part(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "dry.wav", np.eye(200, 4), RATE)
    (read,) = read_responses(labels(tmp_path, "dry.wav,0"), ARRAY)
    with pytest.raises(InputError, match=r"dry\.wav: ends within 30 ms of its direct sound"):
        read.late_mn()


def test_microphones_are_on_the_channels_of_the_array(tmp_path: Path) -> None:
    six_nm = np.concatenate([np.zeros((4000, 2)), response(ARRAY, 30)], axis=1)
    soundfile.write(tmp_path / "six.wav", six_nm, RATE, subtype="FLOAT")
    (read,) = read_responses(labels(tmp_path, "six.wav,30"), replace(ARRAY, channels=(6, 5, 4, 3)))
    impulse_mn = read.impulse_mn()
    assert np.allclose(impulse_mn, six_nm.T[[5, 4, 3, 2]][:, 4000 - impulse_mn.shape[1] :])


def test_rooms_settings_and_distances_are_read(tmp_path: Path) -> None:
    write_room(tmp_path, ARRAY, [0, 30])
    labels(tmp_path, "0.flac,0,lab,open,1.5", "1.wav,30,lab,,", first="file,azimuth_deg,room,setting,distance_m")
    responses = read_responses(tmp_path, ARRAY)
    assert [(each.setting, each.distance_m) for each in responses] == [("lab open", 1.5), ("lab", None)]


def test_sofa_files_have_their_own_directions(write_sofa: Callable[..., Path]) -> None:
    path = write_sofa(ARRAY, [0, 90, 200], SourcePosition=np.array([[0, 0, 2], [90, 14, 2], [200, 40, 2]]))
    responses = read_responses(labels(path.parent, "measured.sofa,"), ARRAY)
    assert [round(float(np.rad2deg(each.azimuth))) for each in responses] == [0, 90]
    assert responses[1].where == f"{path}, measurement 2"
    lead_m = ARRAY.positions[:, 1]
    arrival_m = np.abs(responses[1].impulse_mn()).argmax(axis=1)
    assert np.abs(arrival_m - arrival_m.min() - (lead_m.max() - lead_m) / 343 * RATE).max() <= 1.5


def test_one_measurement_of_a_sofa_file_has_the_direction_of_the_list(write_sofa: Callable[..., Path]) -> None:
    path = write_sofa(ARRAY, [0])
    (read,) = read_responses(labels(path.parent, "measured.sofa,-170"), ARRAY)
    assert np.rad2deg(read.azimuth) == pytest.approx(-170)


def test_delays_of_sofa_files_are_applied(write_sofa: Callable[..., Path]) -> None:
    late = write_sofa(ARRAY, [0], Data_Delay=np.array([[0.0, 0.0, 64.0, 0.0]]))
    (plain,) = read_responses(labels(write_sofa(ARRAY, [0]).parent, "measured.sofa,0"), ARRAY)
    (delayed,) = read_responses(labels(late.parent, "measured.sofa,0"), ARRAY)
    shift_m = [np.abs(each.impulse_mn()).argmax(axis=1) for each in (plain, delayed)]
    # Half as many at 16 kHz as at the file's 32.
    assert (shift_m[1] - shift_m[0]).tolist() == [0, 0, 32, 0]


@pytest.mark.parametrize(
    ("changes", "line", "says"),
    [
        ({}, "measured.sofa,30", "has 2 measurements; leave azimuth_deg empty"),
        ({"SourcePosition": np.array([[0, 80, 1], [9, -80, 1]])}, "measured.sofa,", "no source within 15 degrees"),
        ({"Data_SamplingRate": 0.0}, "measured.sofa,", "the sampling rate is 0 Hz"),
        ({"Data_Delay": np.full((1, 4), -1.0)}, "measured.sofa,", "'Data.Delay' has a negative value"),
        ({"Data_IR": np.full((2, 4, 8), np.nan)}, "measured.sofa,", "are not finite numbers"),
    ],
)
def test_sofa_files_that_cannot_be_used_are_named(
    changes: dict[str, object], line: str, says: str, write_sofa: Callable[..., Path]
) -> None:
    path = write_sofa(ARRAY, [0, 9], **changes)
    assert says in refused(labels(path.parent, line))


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (["0.flac,north"], "labels.csv, line 2: azimuth_deg holds 'north'; give degrees from -360 to 360."),
        (["0.flac,nan"], "azimuth_deg holds 'nan'"),
        (["0.flac,"], "labels.csv, line 2: azimuth_deg is empty; give the loudspeaker's azimuth in degrees."),
        (["0.flac,0", "0.flac,30"], "labels.csv, line 3: 0.flac is listed above already"),
        (["gone.wav,0"], "labels.csv, line 2: there is no file"),
        ([",0"], "labels.csv, line 2: column 'file' is empty"),
        (["labels.csv,0"], "labels.csv: cannot be read as audio"),
        ([], "labels.csv: holds nothing below its first line"),
        (["long.wav,0"], "long.wav: lasts 10.5 s; an impulse response lasts up to 10 s"),
        (["mute.wav,0"], "mute.wav: is silent throughout; give a measured response."),
        (["dead.wav,0"], "dead.wav: channel 3 is dead"),
        (["stereo.wav,0"], "stereo.wav: 2 channel(s), but array 'circle4' has 4 microphones"),
    ],
)
def test_a_list_that_cannot_be_used_is_named(lines: list[str], says: str, tmp_path: Path) -> None:
    write_room(tmp_path, ARRAY, [0])
    noise_nm = np.random.default_rng(0).standard_normal((168_000, 4))
    for name, audio_nm in {
        "long": noise_nm,
        "mute": 0 * noise_nm[:800],
        "dead": noise_nm[:800] * [1, 1, 0, 1],
        "stereo": noise_nm[:800, :2],
    }.items():
        soundfile.write(tmp_path / f"{name}.wav", 0.1 * audio_nm, RATE)
    assert says in refused(labels(tmp_path, *lines))


def test_distances_must_be_metres(tmp_path: Path) -> None:
    write_room(tmp_path, ARRAY, [0])
    for text in ("far", "-1", "0"):
        labels(tmp_path, f"0.flac,0,{text}", first="file,azimuth_deg,distance_m")
        assert "metres above 0" in refused(tmp_path)


def test_a_missing_folder_or_column_is_named(tmp_path: Path) -> None:
    assert "no such folder of room responses" in refused(tmp_path / "gone")
    assert "labels.csv: no such file; write one with the first line file,azimuth_deg" in refused(tmp_path)
    labels(tmp_path, "0.wav,0", first="file,azimuth")
    assert "column 'azimuth_deg' is missing" in refused(tmp_path)

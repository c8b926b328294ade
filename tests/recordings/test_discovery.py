from pathlib import Path

import pytest
from recorded import write_noise, write_video

from avssl_pyro.errors import InputError
from avssl_pyro.recordings.discovery import (
    Alignment,
    read_recording_list,
    recordings_in_folder,
    unique_names,
)


def test_a_folder_pairs_equal_names(tmp_path: Path) -> None:
    for name in ("b.mp4", "b.WAV", "a.avi", "a.flac", "c.wav", "d.mp4", "notes.txt"):
        (tmp_path / name).touch()
    pairs, alone = recordings_in_folder(tmp_path, Alignment(yaw_deg=5.0))
    assert [(pair.video.name, pair.audio.name, pair.alignment.yaw_deg) for pair in pairs] == [
        ("a.avi", "a.flac", 5.0),
        ("b.mp4", "b.WAV", 5.0),
    ]
    assert [path.name for path in alone] == ["c.wav", "d.mp4"]
    (tmp_path / "a.wav").touch()
    with pytest.raises(InputError, match=r"a\.flac and a\.wav are both 'a'"):
        recordings_in_folder(tmp_path, Alignment())


def test_a_list_overrides_what_it_names(tmp_path: Path) -> None:
    path = tmp_path / "list.csv"
    path.write_text("video,audio,offset_s,yaw_deg\nx/v.mp4,a.wav,0.25,\nw.mp4,b.wav,,-90\n")
    first, second = read_recording_list(path, Alignment(offset_s=1.0, yaw_deg=2.0, mirror=True))
    assert (first.video, first.audio) == (tmp_path / "x/v.mp4", tmp_path / "a.wav")
    assert (first.alignment.offset_s, first.alignment.yaw_deg, first.alignment.mirror) == (0.25, 2.0, True)
    assert (second.alignment.offset_s, second.alignment.yaw_deg) == (1.0, -90.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("video\nv.mp4\n", "column 'audio' is missing; the first line must be: video,audio"),
        ("video,audio,yaw\nv.mp4,a.wav,3\n", "column 'yaw' is unknown"),
        ("video,audio\n", "holds nothing below its first line"),
        ("video,audio\nv.mp4,\n", "line 2: column 'audio' is empty"),
        ("video,audio,yaw_deg\nv.mp4,a.wav,left\n", "line 2: yaw_deg is 'left'"),
    ],
)
def test_bad_lists_are_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "list.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_recording_list(path, Alignment())


def test_recordings_of_one_name_get_names_of_their_own(tmp_path: Path) -> None:
    for folder in ("1", "2"):
        write_noise(tmp_path / folder / "a.wav", [0.1])
        write_video(tmp_path / folder / "a.mp4", 10)
    opened = [recordings_in_folder(tmp_path / folder, Alignment())[0][0].open() for folder in ("1", "2")]
    assert [recording.name for recording in unique_names(opened)] == ["a", "a-r1"]

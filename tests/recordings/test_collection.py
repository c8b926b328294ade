"""Collections of recordings: their kind by their content, and their recordings."""

from pathlib import Path

import pytest
from recorded import write_noise, write_video

from avssl_pyro.errors import InputError
from avssl_pyro.recordings.collection import CollectionKind, collection_kind, open_collection
from avssl_pyro.recordings.recording import Alignment


def pair(folder: Path, name: str = "a") -> Path:
    write_noise(folder / f"{name}.wav", [0.1])
    write_video(folder / f"{name}.mp4", 10)
    return folder


def listed(folder: Path, name: str = "recordings.csv") -> Path:
    pair(folder)
    path = folder / name
    # As spreadsheets write it, with a byte order mark.
    path.write_text("audio,video,yaw_deg\na.wav,a.mp4,90\n", encoding="utf-8-sig")
    return path


def starss(folder: Path) -> Path:
    write_noise(folder / "mic_dev" / "dev-train-tau" / "fold3_room4_mix001.wav", [0.1], 4, 24_000, "PCM_16")
    return folder


def test_the_content_tells_the_kind(tmp_path: Path) -> None:
    assert collection_kind(pair(tmp_path / "folder")) is CollectionKind.FOLDER
    assert collection_kind(listed(tmp_path / "list")) is CollectionKind.LIST
    assert collection_kind(listed(tmp_path / "text", "names.txt")) is CollectionKind.LIST
    assert collection_kind(starss(tmp_path / "starss")) is CollectionKind.STARSS23


def test_a_list_lacking_a_column_is_a_list_nevertheless(tmp_path: Path) -> None:
    path = tmp_path / "list.csv"
    path.write_text("video\na.mp4\n")
    with pytest.raises(InputError, match="column 'audio' is missing"):
        open_collection(path, Alignment())


@pytest.mark.parametrize("name", ["empty", "inside/mic_dev", "table.csv", "a.mp4", "empty.csv", "missing"])
def test_other_content_is_refused_with_what_was_looked_for(name: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    starss(tmp_path / "inside")
    (tmp_path / "table.csv").write_text("file,azimuth_deg\na.wav,90\n")
    (tmp_path / "empty.csv").touch()
    write_video(tmp_path / "a.mp4", 10)
    with pytest.raises(InputError) as error_info:
        collection_kind(tmp_path / name)
    message = str(error_info.value)
    assert message.startswith(f"{tmp_path / name}: ")
    assert all(words in message for words in ("same names", "columns video and audio", "mic_dev or foa_dev"))


def test_a_folder_names_what_it_leaves_out(tmp_path: Path) -> None:
    pair(tmp_path, "b")
    write_noise(tmp_path / "alone.wav", [0.1])
    found = open_collection(tmp_path, Alignment(yaw_deg=5.0))
    assert ([entry.name for entry in found.recordings], found.labels) == (["b"], None)
    assert [remark.split(": ")[0] for remark in found.remarks] == [str(tmp_path / "alone.wav")]


def test_starss_without_videos_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no recording of dev-train has a video; expected them in video_dev"):
        open_collection(starss(tmp_path), Alignment())


def test_starss_takes_the_alignment_of_a_turned_camera(tmp_path: Path) -> None:
    write_video(starss(tmp_path) / "video_dev" / "fold3_room4_mix001.mp4", 10)
    found = open_collection(tmp_path, Alignment(yaw_deg=33.0, mirror=True))
    ((recording,), labels) = found.recordings, found.labels
    assert (recording.name, recording.yaw_deg, recording.mirror, labels) == ("fold3_room4_mix001", 33.0, True, (None,))

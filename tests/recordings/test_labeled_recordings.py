from math import pi
from pathlib import Path

import pytest

from avssl_pyro.errors import InputError
from avssl_pyro.recordings.labeled_recordings import LabeledRecording, read_labeled_recordings


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("one.wav", "none.wav"):
        (tmp_path / name).touch()
    return tmp_path


def write(folder: Path, text: str) -> None:
    (folder / "labels.csv").write_text(text, encoding="utf-8")


def test_reads_any_number_of_talkers_and_leaves_other_columns_alone(folder: Path) -> None:
    # As a spreadsheet writes it, with a byte order mark.
    write(folder, "\ufeffroom,azimuth_deg,file\nhall,180 -90  45,one.wav\nhall,,none.wav\n")
    one, none = read_labeled_recordings(folder)
    assert one.path == folder / "one.wav" and one.azimuths == pytest.approx((pi, -pi / 2, pi / 4))
    assert none == LabeledRecording(folder / "none.wav", ())


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("file,azimuth\none.wav,3\n", "column 'azimuth_deg' is missing"),
        ("", "column 'file' is missing"),
        ("file,azimuth_deg\n", "holds nothing below its first line"),
        ("file,azimuth_deg\none.wav,3\n,4\n", "line 3: column 'file' is empty"),
        ("file,azimuth_deg\none.wav\n", "line 2: it has no field for azimuth_deg"),
        ("file,azimuth_deg\ntwo.wav,3\n", "line 2: there is no file"),
        ("file,azimuth_deg\none.wav,left\n", "line 2: azimuth_deg holds 'left'; give degrees"),
        ("file,azimuth_deg\none.wav,30;60\n", "line 2: azimuth_deg holds '30;60'"),
        ("file,azimuth_deg\none.wav,nan\n", "line 2: azimuth_deg holds 'nan'"),
        ("file,azimuth_deg\none.wav,361\n", "line 2: azimuth_deg holds '361'"),
        ("file,azimuth_deg\none.wav,3\none.wav,4\n", "one.wav is listed twice"),
    ],
)
def test_a_bad_list_is_told_in_one_sentence(text: str, says: str, folder: Path) -> None:
    write(folder, text)
    with pytest.raises(InputError, match=r"labels\.csv") as error:
        read_labeled_recordings(folder)
    assert says in str(error.value) and "\n" not in str(error.value)


def test_a_list_that_is_no_text_is_told(folder: Path) -> None:
    (folder / "labels.csv").write_bytes(b"\xff\xfe\x00\xd8")
    with pytest.raises(InputError, match="cannot be read as CSV"):
        read_labeled_recordings(folder)


def test_a_missing_folder_or_list_is_told(folder: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        read_labeled_recordings(folder / "nowhere")
    with pytest.raises(InputError, match="write one with the first line file,azimuth_deg"):
        read_labeled_recordings(folder)

from pathlib import Path

import numpy as np
import pytest
import soundfile

from avssl_pyro.io.audio import write_separated


def test_every_source_has_a_file_named_after_its_direction(tmp_path: Path) -> None:
    sound_sn = np.array([[0.5, -1.75, 1e-6], [0.0, 0.25, 0.5]], dtype=np.float32)
    folder = tmp_path / "new" / "folder"
    paths = write_separated(folder, "clip", np.deg2rad([34.4, -100.6]).tolist(), sound_sn)
    assert [path.name for path in paths] == ["clip-source1-az+034.wav", "clip-source2-az-101.wav"]
    assert set(folder.iterdir()) == set(paths)
    for path, sound_n in zip(paths, sound_sn, strict=True):
        read_n, rate = soundfile.read(path, dtype="float32")
        assert rate == 16_000
        # What is louder than full scale is not clipped.
        np.testing.assert_array_equal(read_n, sound_n)


def test_sources_in_one_direction_have_files_of_their_own(tmp_path: Path) -> None:
    assert len(set(write_separated(tmp_path, "clip", [0.0, 0.001], np.zeros((2, 5), np.float32)))) == 2


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_leaves_no_piece_of_a_file(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"clip-source1-az\+000\.wav"):
        write_separated(tmp_path, "clip", [0.0], np.zeros((1, 5), np.float32))
    assert not list(tmp_path.iterdir())

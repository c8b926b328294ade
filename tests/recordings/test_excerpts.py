from pathlib import Path

import numpy as np
import pytest
import soundfile
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.recordings.excerpts import Excerpts, evenly, read_excerpts


@given(st.integers(0, 500), st.integers(1, 60))
def test_evenly_is_sorted_inside_and_without_repeats(total: int, most: int) -> None:
    chosen = evenly(total, most)
    assert len(chosen) == min(total, most)
    assert chosen == sorted(set(chosen))
    assert all(0 <= index < total for index in chosen)
    if total > 1 and chosen:
        assert chosen[0] - 0 <= total / len(chosen)
        assert total - 1 - chosen[-1] <= total / len(chosen)


def test_a_long_file_is_read_in_seconds_from_all_over_it(tmp_path: Path) -> None:
    second_n = np.repeat(np.arange(10) / 100, 8_000)
    soundfile.write(tmp_path / "steps.wav", np.stack([second_n, -second_n], axis=1), 8_000, subtype="PCM_24")
    excerpts = read_excerpts(tmp_path / "steps.wav", most=5)
    assert excerpts.raw_bmn.shape == (5, 2, 8_000)
    assert excerpts.audio_bmn.shape == (5, 2, 16_000)
    assert excerpts.raw_bmn[:, 0, 4_000] == pytest.approx([0.01, 0.03, 0.05, 0.07, 0.09], abs=1e-6)


def test_channels_keep_their_numbers(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "four.wav", np.tile(np.arange(4) / 8, (3_000, 1)), 16_000)
    excerpts = read_excerpts(tmp_path / "four.wav").select((3, 1))
    assert excerpts.names == (3, 1)
    assert excerpts.raw_bmn[0, :, 0] == pytest.approx([3 / 8, 1 / 8], abs=1e-4)
    assert excerpts.select((1,)).names == (1,)


def test_clips_are_cut_to_the_shortest() -> None:
    image_ijc = np.zeros((88, 288, 3), np.uint8)
    clips = [Clip(str(n), np.zeros((2, n), np.float32), image_ijc) for n in (900, 700)]
    assert Excerpts.of_clips(clips).raw_bmn.shape == (2, 2, 700)
    with pytest.raises(InputError, match="at least one"):
        Excerpts.of_clips([])


def test_bad_files_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such audio file"):
        read_excerpts(tmp_path / "none.wav")
    (tmp_path / "text.wav").write_text("no sound")
    with pytest.raises(InputError, match=r"text\.wav: cannot be read as audio"):
        read_excerpts(tmp_path / "text.wav")
    soundfile.write(tmp_path / "short.wav", np.zeros((100, 2)), 16_000)
    with pytest.raises(InputError, match=r"100 samples at 16000 Hz; at least 0\.1 s"):
        read_excerpts(tmp_path / "short.wav")
    broken_nm = np.zeros((16_000, 2), np.float32)
    broken_nm[70, 1] = np.inf
    soundfile.write(tmp_path / "broken.wav", broken_nm, 16_000, subtype="FLOAT")
    with pytest.raises(InputError, match="sample 70 of channel 2 is not a finite number"):
        read_excerpts(tmp_path / "broken.wav")

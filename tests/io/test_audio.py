"""Reading a recording: which channels become which microphones."""

from pathlib import Path

import numpy as np
import pytest
import soundfile

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.errors import InputError
from avssl_pyro.io.audio import read_audio

PAIR = MicrophoneArray("pair", ((0.1, 0.0, 0.0), (-0.1, 0.0, 0.0)), channels=(4, 2))


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Six channels, each of them constant: channel 1 is 0.1, channel 2 is 0.2, and so on."""
    path = tmp_path / "six.wav"
    soundfile.write(path, np.tile(np.arange(1, 7) / 10, (16_000, 1)), 16_000, subtype="FLOAT")
    return path


def test_channels_are_read_in_the_order_of_the_microphones(recording: Path) -> None:
    audio_mn = read_audio(recording, PAIR)
    assert audio_mn.shape == (2, 16_000)
    assert audio_mn[:, 0] == pytest.approx([0.4, 0.2])
    assert read_audio(recording, PRESETS["circle6"])[:, 0] == pytest.approx(np.arange(1, 7) / 10)


def test_without_a_map_all_channels_must_be_microphones(recording: Path) -> None:
    with pytest.raises(InputError, match=r"six\.wav: 6 channel\(s\), but array 'circle4' has 4 .*'channels'"):
        read_audio(recording, PRESETS["circle4"])


def test_a_map_beyond_the_recording_is_refused(recording: Path) -> None:
    array = MicrophoneArray("pair", PAIR.positions_m, channels=(1, 8))
    with pytest.raises(InputError, match=r"six\.wav: 6 channel\(s\), but microphone 2 .* is on channel 8"):
        read_audio(recording, array)


def test_a_broken_sample_is_named_by_its_channel_in_the_file(tmp_path: Path) -> None:
    audio_nm = np.zeros((8000, 6))
    audio_nm[5, 3] = np.nan
    path = tmp_path / "nan.wav"
    soundfile.write(path, audio_nm, 16_000, subtype="FLOAT")
    with pytest.raises(InputError, match="sample 5 of channel 4 is not a finite number"):
        read_audio(path, PAIR)

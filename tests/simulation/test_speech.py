from pathlib import Path

import numpy as np
import pytest
import soundfile
from hypothesis import given
from hypothesis import strategies as st

from avssl_pyro.errors import InputError
from avssl_pyro.simulation.speech import SpeechFolder, active_excerpt
from avssl_pyro.simulation.synthetic.speech import ProceduralSpeech


def tone(seconds: float, rate: int, frequency_hz: float = 440.0) -> np.ndarray:
    return 0.1 * np.sin(2 * np.pi * frequency_hz * np.arange(round(seconds * rate)) / rate)


def rms(signal_n: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(signal_n, dtype=np.float64))))


@pytest.mark.parametrize(("suffix", "rate", "channels"), [("wav", 16000, 1), ("flac", 44100, 2), ("WAV", 8000, 3)])
def test_any_rate_and_channel_count_is_brought_to_16_khz(tmp_path: Path, suffix: str, rate: int, channels: int) -> None:
    (tmp_path / "speaker").mkdir()
    soundfile.write(tmp_path / "speaker" / f"a.{suffix}", np.stack([tone(3.0, rate)] * channels, axis=1), rate)
    drawn_n = SpeechFolder(tmp_path).draw(np.random.default_rng(0), 16000)
    assert drawn_n.shape == (16000,)
    assert drawn_n.dtype == np.float32
    assert rms(drawn_n) == pytest.approx(1.0, rel=1e-4)
    assert np.abs(np.fft.rfft(drawn_n * np.hanning(16000))).argmax() == 440


def test_a_short_file_is_set_into_silence(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "short.wav", tone(0.25, 16000), 16000)
    drawn_n = SpeechFolder(tmp_path).draw(np.random.default_rng(1), 16000)
    assert drawn_n.shape == (16000,)
    sounding = np.flatnonzero(drawn_n)
    assert sounding[-1] - sounding[0] < 4000


@given(st.integers(0, 2**32 - 1), st.floats(0.2, 3.0))
def test_an_excerpt_falls_on_speech_wherever_it_is(seed: int, before_s: float) -> None:
    silence = np.zeros(round(before_s * 16000))
    recording_n = np.concatenate([silence, tone(1.6, 16000), np.zeros(20000)])
    excerpt_n = active_excerpt(recording_n, 16000, np.random.default_rng(seed))
    assert excerpt_n.shape == (16000,)
    assert np.mean(excerpt_n != 0) > 0.6


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"not audio at all", "cannot read"),
        (np.zeros(32000), "silent"),
        (np.zeros(0), "empty"),
        (np.array([0.1, np.nan] * 16000), "NaN"),
    ],
)
def test_a_bad_file_is_named(tmp_path: Path, content: bytes | np.ndarray, reason: str) -> None:
    path = tmp_path / "broken.wav"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        soundfile.write(path, content, 16000, subtype="FLOAT")
    with pytest.raises(InputError, match=rf"broken\.wav: .*{reason}"):
        SpeechFolder(tmp_path).draw(np.random.default_rng(0), 16000)


def test_an_empty_or_missing_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no speech")
    with pytest.raises(InputError, match=r"has no speech file"):
        SpeechFolder(tmp_path)
    with pytest.raises(InputError, match=r"nowhere: no such folder"):
        SpeechFolder(tmp_path / "nowhere")


def test_procedural_voices_are_sparse_varied_and_loud_throughout() -> None:
    voices = ProceduralSpeech()
    rng = np.random.default_rng(5)
    drawn_sn = np.stack([voices.draw(rng, 16000) for _ in range(12)])
    assert [rms(drawn_n) for drawn_n in drawn_sn] == pytest.approx([1.0] * 12, rel=1e-4)
    assert np.abs(drawn_sn).max() < 15
    frames_stn = drawn_sn[:, : 31 * 512].reshape(12, 31, 512) * np.hanning(512)
    power_stf = np.abs(np.fft.rfft(frames_stn)) ** 2
    ordered = np.sort(power_stf.reshape(12, -1), axis=1)[:, ::-1].cumsum(axis=1)
    # White noise needs about 60 % of its bins for 90 % of its energy, read speech about 3 %.
    share_s = np.mean(ordered < 0.9 * ordered[:, -1:], axis=1)
    assert share_s.max() < 0.15
    peaks_hz = power_stf.mean(axis=1).argmax(axis=1) * 16000 / 512
    assert len(set(peaks_hz)) > 4

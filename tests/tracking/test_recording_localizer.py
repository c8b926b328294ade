"""A recording by one library function: its windows, their tracks, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import soundfile

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.errors import InputError
from avssl_pyro.interruption import GracefulInterrupt
from avssl_pyro.localization.direct_level import DirectLevelRule
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.recordings.recording import Alignment
from avssl_pyro.systems.pretrained import load_weights_of
from avssl_pyro.tracking.recording_localizer import localize_recording, open_recording, recording_gains

ARRAY = PRESETS["circle2"]
EVERYTHING = DirectLevelRule(least=0.0)


@pytest.fixture(scope="module")
def localizer() -> Localizer:
    return Localizer(load_weights_of("circle2"), rule=EVERYTHING)


@pytest.fixture
def audio(tmp_path: Path) -> Path:
    path = tmp_path / "walk.wav"
    soundfile.write(path, np.random.default_rng(0).normal(0, 0.1, (48_000, 2)), 16_000)
    return path


def test_every_window_has_the_sources_of_its_clip(localizer: Localizer, audio: Path) -> None:
    recording = open_recording(audio, None, ARRAY, Alignment())
    timeline = localize_recording(recording, localizer, rate_hz=2.0, tracking=False)
    assert [frame.time_s for frame in timeline.frames] == pytest.approx([0.5, 1.0, 1.5, 2.0, 2.5])
    for frame, (_, clip) in zip(timeline.frames, recording.windows(0.5), strict=True):
        (expected,) = localizer.localize([clip])
        assert [source.name for source in frame.sources] == [source.source_class for source in expected.sources]
        assert [source.azimuth_deg for source in frame.sources] == pytest.approx(
            [source.azimuth_deg for source in expected.sources], abs=1e-3
        )


def test_sources_are_linked_unless_windows_are_wanted_alone(localizer: Localizer, audio: Path) -> None:
    recording = open_recording(audio, None, ARRAY, Alignment())
    alone = localize_recording(recording, localizer, tracking=False)
    linked = localize_recording(recording, localizer)
    assert len(linked.frames) == len(alone.frames)
    assert set(linked.names) <= set(range(len(linked.names)))


def test_an_interrupt_ends_the_timeline_early(localizer: Localizer, audio: Path) -> None:
    stop = GracefulInterrupt()
    stop.requested = True
    timeline = localize_recording(open_recording(audio, None, ARRAY, Alignment()), localizer, interrupt=stop)
    assert [frame.time_s for frame in timeline.frames] == [0.5]


def test_bad_recordings_are_refused(localizer: Localizer, audio: Path, tmp_path: Path) -> None:
    recording = open_recording(audio, None, ARRAY, Alignment())
    with pytest.raises(InputError, match="the rate is 0; give a number of results per second"):
        localize_recording(recording, localizer, rate_hz=0.0)
    with pytest.raises(InputError, match=r"2 channel\(s\), but array 'circle4' has 4 microphones"):
        open_recording(audio, None, PRESETS["circle4"], Alignment())
    short = tmp_path / "short.wav"
    soundfile.write(short, np.random.default_rng(0).normal(0, 0.1, (8_000, 2)), 16_000)
    with pytest.raises(InputError, match=r"0.50 s in common; a result needs 1 s"):
        open_recording(short, None, ARRAY, Alignment())


def test_gains_are_those_of_the_whole_recording_not_of_a_quiet_window(localizer: Localizer, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    loud_nm = 0.05 * (rng.standard_normal((48_000, 1)) + 0.1 * rng.standard_normal((48_000, 2))) * [1, 2]
    # The recorder's own noise is the same in both channels.
    quiet_nm = 1e-4 * rng.standard_normal((48_000, 2))
    path = tmp_path / "louder.wav"
    soundfile.write(path, np.concatenate([quiet_nm, loud_nm]), 16_000, subtype="FLOAT")
    recording = open_recording(path, None, ARRAY, Alignment())
    gains = recording_gains(recording, localizer)
    assert gains.remarks() == ("channel 2 is 6 dB louder than the other",)
    timeline = localize_recording(recording, localizer, tracking=False)
    for frame, (_, clip) in zip(timeline.frames, recording.windows(0.5), strict=True):
        (expected,) = localizer.with_gains(gains).localize([clip])
        assert [source.level for source in frame.sources] == pytest.approx(
            [source.level for source in expected.sources]
        )

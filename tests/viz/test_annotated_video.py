"""The annotated video, read back: who is marked where, in which color, and what is heard."""

from pathlib import Path

import av
import numpy as np
import numpy.typing as npt
import pytest
import soundfile

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.errors import InputError
from avssl_pyro.io.audio import AudioFile
from avssl_pyro.io.video_reader import VideoFile
from avssl_pyro.io.video_writer import open_video
from avssl_pyro.recordings.recording import Recording
from avssl_pyro.tracking.timeline import IdentifiedSource, Timeline, TimelineFrame
from avssl_pyro.viz.annotated_video import save_annotated_video, stereo_pair
from avssl_pyro.viz.palette import OKABE_ITO

ROWS, COLUMNS, FRAME_RATE, SECONDS = 480, 960, 12.5, 2.0
ARRAY = PRESETS["circle4"]


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    """Gray frames; 400 Hz on the leftmost microphone, silence elsewhere; the audio began half a second later."""
    video, audio = tmp_path / "gray.mp4", tmp_path / "gray.wav"
    with open_video(video, COLUMNS, ROWS, FRAME_RATE) as out:
        for index in range(round(SECONDS * FRAME_RATE)):
            out.write(np.full((ROWS, COLUMNS, 3), 128, np.uint8), index / FRAME_RATE)
    # So many samples that the last one at 16 kHz would be there by rounding only.
    samples_nm = np.zeros((30_003, 4))
    left, _ = stereo_pair(ARRAY)
    samples_nm[:, left] = 0.5 * np.sin(2 * np.pi * 400 * np.arange(30_003) / 22_050)
    soundfile.write(audio, samples_nm, 22_050)
    return Recording("gray", AudioFile(audio), VideoFile(video), offset_s=-0.5)


def azimuth_deg(time_s: float) -> float:
    """Somebody walks across the seam: 165 to 195 degrees in two seconds."""
    return 165 + 15 * time_s


def walk() -> Timeline:
    """Source 5 walks across the seam, source 2 comes later, stays at -60 and is louder."""
    moments = []
    for time_s in np.arange(0.0, 2.01, 0.1):
        sources = [IdentifiedSource(5, float(np.deg2rad(azimuth_deg(time_s))), 0.05, 0.2)]
        if time_s > 0.95:
            sources.insert(0, IdentifiedSource(2, float(np.deg2rad(-60)), 0.05, 0.5))
        moments.append(TimelineFrame(float(time_s), tuple(sources)))
    return Timeline(tuple(moments), 0.1, 0.5)


def center(frame_ijc: npt.NDArray[np.uint8], color: int) -> float:
    """Azimuth of the line of a color, degrees, by its columns around the ring; NaN if there is none."""
    # Video halves the resolution of colors, so lines are told by their hue, clear of labels and clock.
    part_ijc = frame_ijc[120:400].astype(np.float64).mean(axis=0)
    tint_jc = part_ijc - part_ijc.mean(axis=-1, keepdims=True)
    target = 255 * (np.array(OKABE_ITO[color]) - np.mean(OKABE_ITO[color]))
    share_j = tint_jc @ target / (target @ target)
    across_j = np.linalg.norm(tint_jc - share_j[:, None] * target, axis=-1)
    weight_j = np.where((share_j > 0.4) & (across_j < 25), share_j, 0.0)
    if not weight_j.any():
        return float("nan")
    angles_j = np.pi - 2 * np.pi * (np.arange(COLUMNS) + 0.5) / COLUMNS
    return float(np.rad2deg(np.angle((weight_j * np.exp(1j * angles_j)).sum())))


def test_markers_follow_their_sources_in_their_own_colors_and_across_the_seam(
    recording: Recording, tmp_path: Path
) -> None:
    path, times_s = tmp_path / "out.mp4", []
    save_annotated_video(path, recording, walk(), ARRAY, on_frame=times_s.append)
    with av.open(str(path)) as container:
        assert container.streams.video[0].codec_context.pix_fmt == "yuv420p"
        frames = [(float(frame.time or 0), frame.to_ndarray(format="rgb24")) for frame in container.decode(video=0)]
    assert [time_s for time_s, _ in frames] == pytest.approx(np.arange(25) / FRAME_RATE, abs=1e-3)
    assert times_s == pytest.approx([time_s for time_s, _ in frames], abs=1e-3)
    for time_s, frame_ijc in frames:
        off_deg = (center(frame_ijc, 0) - azimuth_deg(time_s) + 180) % 360 - 180
        assert abs(off_deg) < 1.0, time_s
        # The second one has the second color, although its number is lower and it is louder.
        late = center(frame_ijc, 1)
        assert (abs(late + 60) < 1.0) if time_s > 0.95 else np.isnan(late), time_s


def test_the_sound_fits_the_picture_and_left_is_left(recording: Recording, tmp_path: Path) -> None:
    path = tmp_path / "out.mp4"
    save_annotated_video(path, recording, walk(), ARRAY)
    with av.open(str(path)) as container:
        sound_cn = np.concatenate([frame.to_ndarray() for frame in container.decode(audio=0)], axis=1)
    loud_n = np.flatnonzero(np.abs(sound_cn[0]) > 0.1) / 48_000
    assert loud_n[0] == pytest.approx(0.5, abs=0.05)
    assert loud_n[-1] == pytest.approx(1.86, abs=0.05)
    assert np.abs(sound_cn[1]).max() < 0.05


def test_without_a_video_there_is_nothing_to_draw_on(recording: Recording, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no video; give a recording"):
        save_annotated_video(tmp_path / "out.mp4", Recording("blind", recording.audio), walk(), ARRAY)


def test_the_ears_are_the_outermost_microphones() -> None:
    # circle4: straight ahead, left, behind, right.
    assert stereo_pair(ARRAY) == (1, 3)

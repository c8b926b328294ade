import pickle
from math import gcd
from pathlib import Path

import numpy as np
import pytest
import soundfile
from recorded import FPS, frame_number, stretch_frame, write_frames, write_noise, write_video
from scipy.signal import resample_poly

from avssl_pyro.errors import InputError
from avssl_pyro.io.audio import AudioFile
from avssl_pyro.io.video_reader import VideoFile
from avssl_pyro.recordings.recording import Recording


@pytest.mark.parametrize("rate", [8_000, 16_000, 24_000, 44_100, 48_000])
def test_any_stretch_is_what_resampling_the_whole_file_gives(tmp_path: Path, rate: int) -> None:
    audio_nm = 0.1 * np.random.default_rng(0).standard_normal((2 * rate + 17, 3)).astype(np.float32)
    path = tmp_path / "audio.wav"
    soundfile.write(path, audio_nm, rate, subtype="FLOAT")
    file = AudioFile(path)
    divisor = gcd(rate, 16_000)
    whole_nm = audio_nm if rate == 16_000 else resample_poly(audio_nm, 16_000 // divisor, rate // divisor, axis=0)
    for first, count in ((0, 100), (1, 16_000), (777, 12_345), (file.num_samples - 999, 999), (0, file.num_samples)):
        np.testing.assert_allclose(file.read_samples(first, count), whole_nm[first : first + count].T, atol=1e-6)
    np.testing.assert_allclose(
        np.concatenate(list(file.blocks(0.3)), axis=1), whole_nm[: file.num_samples].T, atol=1e-6
    )


@pytest.mark.parametrize(("name", "subtype"), [("a.wav", "PCM_16"), ("a.wav", "PCM_32"), ("a.flac", "PCM_24")])
def test_sample_formats_and_channel_counts(tmp_path: Path, name: str, subtype: str) -> None:
    for channels in (1, 4, 8):
        file = AudioFile(write_noise(tmp_path / name, [0.1, 0.1], channels, 48_000, subtype))
        assert (file.num_channels, file.sample_rate, file.duration_s) == (channels, 48_000, 2.0)
        audio_mn = file.read(0.5, 1.0)
        assert audio_mn.shape == (channels, 16_000)
        assert audio_mn.dtype == np.float32
        assert audio_mn.mean(axis=1) == pytest.approx(0.01 * np.arange(channels), abs=0.003)


def test_what_lies_outside_or_is_damaged_is_refused(tmp_path: Path) -> None:
    path = write_noise(tmp_path / "a.flac", [0.1, 0.1])
    for start_s, duration_s in ((-0.1, 1.0), (1.5, 1.0), (0.5, 0.0)):
        with pytest.raises(InputError, match=r"lasts from 0 to 2\.000 s"):
            AudioFile(path).read(start_s, duration_s)
    path.write_bytes(path.read_bytes()[:-40_000])
    with pytest.raises(InputError, match=r"a\.flac"):
        AudioFile(path).read(0.5, 1.5)
    with pytest.raises(InputError, match="no such audio file"):
        AudioFile(tmp_path / "none.wav")
    (tmp_path / "text.wav").write_text("no audio")
    with pytest.raises(InputError, match="cannot be read as audio"):
        AudioFile(tmp_path / "text.wav")
    nan_nm = np.zeros((32_000, 2), np.float32)
    nan_nm[20_000, 1] = np.nan
    soundfile.write(tmp_path / "nan.wav", nan_nm, 16_000, subtype="FLOAT")
    with pytest.raises(InputError, match="sample 20000 of channel 2 is not a finite"):
        AudioFile(tmp_path / "nan.wav").read(1.0, 0.5)


def test_frames_are_found_by_time_in_any_order(tmp_path: Path) -> None:
    video = VideoFile(write_video(tmp_path / "v.mp4", 70))
    assert (video.width, video.height, video.duration_s) == (144, 72, pytest.approx(7.0))
    assert [round(time_s, 3) for time_s, _ in video] == [round(number / FPS, 3) for number in range(70)]
    for time_s, number in ((0.0, 0), (0.09, 0), (0.11, 1), (6.95, 69), (1.0, 10), (0.55, 5), (6.9, 69), (0.0, 0)):
        assert frame_number(video.frame_at(time_s)) == number
    copy = pickle.loads(pickle.dumps(video))
    assert frame_number(copy.frame_at(3.05)) == 30
    assert video.time_stamps() == pytest.approx(np.arange(70) / FPS, abs=1e-3)
    with pytest.raises(InputError, match=r"no frame within 1 s before 9\.000 s"):
        video.frame_at(9.0)


def test_variable_frame_rates_go_by_time_stamps_and_gaps_show_nothing(tmp_path: Path) -> None:
    path = write_video(tmp_path / "v.mp4", 40)
    stretch_frame(path, 20, 21)
    for times_s in ((1.55, 2.05, 2.9, 4.15, 4.95), (4.95, 4.15, 2.9)):
        video = VideoFile(path)
        found = {time_s: video.find_frame(time_s) for time_s in times_s}
        expected = {1.55: 15, 2.05: 20, 2.9: 20, 4.15: 21, 4.95: 29}
        assert {time_s: frame_number(frame_ijc) for time_s, frame_ijc in found.items() if frame_ijc is not None} == {
            time_s: expected[time_s] for time_s in times_s
        }
    assert VideoFile(path).find_frame(3.5) is None
    assert VideoFile(path).time_stamps()[20:22] == pytest.approx([2.0, 4.1], abs=1e-3)


def test_a_truncated_video_is_named(tmp_path: Path) -> None:
    path = write_video(tmp_path / "v.mp4", 20)
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(InputError, match=r"v\.mp4: cannot be read as video; it is truncated"):
        VideoFile(path)
    with pytest.raises(InputError, match="no such video file"):
        VideoFile(tmp_path / "none.mp4")


@pytest.mark.parametrize(("offset_s", "start_s", "end_s"), [(0.0, 0.0, 3.0), (0.5, 0.0, 3.0), (-1.25, 1.25, 3.0)])
def test_windows_are_the_clips_of_the_common_stretch(
    tmp_path: Path, offset_s: float, start_s: float, end_s: float
) -> None:
    audio = AudioFile(write_noise(tmp_path / "a.wav", [0.1] * 4, num_channels=5))
    video = VideoFile(write_video(tmp_path / "v.mp4", 30))
    recording = Recording("a b", audio, video, offset_s=offset_s, channels=(3, 0))
    assert (recording.start_s, recording.end_s) == (start_s, pytest.approx(end_s))
    windows = list(recording.windows(0.25))
    assert [time_s for time_s, _ in windows] == pytest.approx(np.arange(start_s, end_s - 1.0 + 1e-6, 0.25))
    for time_s, clip in windows:
        np.testing.assert_allclose(clip.audio_mn, audio.read(time_s + offset_s, 1.0)[[3, 0]], atol=1e-6)
        assert clip.key == f"a_b-{round(1e3 * time_s):08d}"
        again = recording.clip_at(time_s)
        np.testing.assert_array_equal(again.image_ijc, clip.image_ijc)
        np.testing.assert_allclose(again.audio_mn, clip.audio_mn, atol=1e-6)


def test_audio_and_video_that_never_meet_are_refused(tmp_path: Path) -> None:
    audio = AudioFile(write_noise(tmp_path / "a.wav", [0.1]))
    video = VideoFile(write_video(tmp_path / "v.mp4", 30))
    with pytest.raises(InputError, match="no moment in common at an offset of 9 s"):
        Recording("r", audio, video, offset_s=9.0)
    with pytest.raises(InputError, match="channel 4 does not exist"):
        Recording("r", audio, video, channels=(0, 4))
    assert Recording("r", audio).clip_at(0.0).image_ijc.std() == 0


def spot_video(path: Path, column: int, size: tuple[int, int], row: int | None = None) -> VideoFile:
    """A white spot on black for a second."""
    width, height = size
    frame_ijc = np.zeros((height, width, 3), np.uint8)
    row = height // 2 if row is None else row
    frame_ijc[row - height // 48 : row + height // 48, column - width // 96 : column + width // 96] = 255
    return VideoFile(write_frames(path, [frame_ijc] * 10))


def spot(image_ijc: np.ndarray) -> tuple[float, float]:
    """Azimuth and elevation of the spot, degrees."""
    bright_ij = image_ijc.mean(axis=-1)
    rows, columns = np.nonzero(bright_ij > 0.6 * bright_ij.max())
    return 180 - 360 * (columns.mean() + 0.5) / 288, 55 - 110 * (rows.mean() + 0.5) / 88


@pytest.mark.parametrize(
    ("yaw_deg", "mirror", "azimuth_deg"),
    [(0, False, 90), (0, True, -90), (30, False, 120), (30, True, -60), (-45, False, 45)],
)
def test_the_picture_is_mirrored_then_turned(tmp_path: Path, yaw_deg: float, mirror: bool, azimuth_deg: float) -> None:
    """+90 degrees is column 480 of 1920, and in the left quarter of a clip's image."""
    audio = AudioFile(write_noise(tmp_path / "a.wav", [0.1]))
    video = spot_video(tmp_path / "v.mp4", 480, (1920, 960))
    image_ijc = Recording("r", audio, video, yaw_deg=yaw_deg, mirror=mirror).image_at(0.5)
    assert spot(image_ijc) == (pytest.approx(azimuth_deg, abs=1.5), pytest.approx(0.0, abs=2.0))
    if (yaw_deg, mirror) == (0, False):
        assert image_ijc[:, :144].mean() > 100 * image_ijc[:, 144:].mean()
        assert image_ijc[:, 60:84].mean() > 5 * image_ijc[:, :60].mean()


@pytest.mark.parametrize(
    ("elevations", "size"), [((-55, 55), (576, 324)), ((-30, 80), (576, 324)), ((-20, 20), (576, 90))]
)
def test_elevations_of_any_camera_come_out_right(
    tmp_path: Path, elevations: tuple[float, float], size: tuple[int, int]
) -> None:
    audio = AudioFile(write_noise(tmp_path / "a.wav", [0.1]))
    low, high = elevations
    row = round((high - 10.0) / (high - low) * size[1])
    video = spot_video(tmp_path / "v.mp4", 432, size, row)
    recording = Recording("r", audio, video, elevation_range_deg=elevations)
    assert spot(recording.image_at(0.5)) == (pytest.approx(-90, abs=1.5), pytest.approx(10.0, abs=2.0))
    with pytest.raises(InputError, match="no range"):
        Recording("r", audio, video, elevation_range_deg=(high, low))


@pytest.mark.parametrize(("size", "words"), [((96, 192), "wider than high"), ((320, 180), "say which elevations")])
def test_pictures_that_are_no_sphere_are_refused(tmp_path: Path, size: tuple[int, int], words: str) -> None:
    recording = Recording(
        "r", AudioFile(write_noise(tmp_path / "a.wav", [0.1])), VideoFile(write_video(tmp_path / "v.mp4", 10, size))
    )
    with pytest.raises(InputError, match=words):
        recording.clip_at(0.0)

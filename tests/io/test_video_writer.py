"""Videos that browsers play, with their own times and their sound, whole or not at all."""

from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import numpy.typing as npt
import pytest

from avssl_pyro.errors import InputError
from avssl_pyro.io.video_writer import SoundTrack, check_video_name, open_video

WIDTH, HEIGHT, RATE = 320, 180, 10.0
SAMPLE_RATE = 16_000


def picture(index: int) -> npt.NDArray[np.uint8]:
    """A red bar on gray that moves to the right."""
    image_ijc = np.full((HEIGHT, WIDTH, 3), 100, np.uint8)
    image_ijc[:, 20 * index : 20 * index + 16] = (200, 40, 40)
    return image_ijc


def tone(seconds: float) -> Iterator[npt.NDArray[np.float32]]:
    """500 Hz at the left, silence at the right, in blocks of odd length."""
    time_n = np.arange(round(seconds * SAMPLE_RATE)) / SAMPLE_RATE
    audio_cn = np.stack([0.5 * np.sin(2 * np.pi * 500 * time_n), np.zeros_like(time_n)]).astype(np.float32)
    yield from np.split(audio_cn, range(777, audio_cn.shape[1], 777), axis=1)


@pytest.mark.parametrize(
    ("name", "video_codec", "audio_codec"), [("out.mp4", "h264", "aac"), ("out.webm", "vp9", "opus")]
)
def test_the_file_has_what_a_browser_needs(name: str, video_codec: str, audio_codec: str, tmp_path: Path) -> None:
    path = tmp_path / name
    # Camera clocks are never quite regular.
    times_s = [0.0, 0.1, 0.21, 0.3, 0.45, 0.5, 0.6, 0.7, 0.8, 0.9]
    with open_video(path, WIDTH, HEIGHT, RATE, SoundTrack(SAMPLE_RATE, tone(1.0))) as video:
        for index, time_s in enumerate(times_s):
            video.write(picture(index), time_s)
    assert [entry.name for entry in tmp_path.iterdir()] == [name]
    with av.open(str(path)) as container:
        stream = container.streams.video[0].codec_context
        assert (stream.name, stream.pix_fmt) == (video_codec, "yuv420p")
        assert container.streams.audio[0].codec_context.name == audio_codec
        frames = list(container.decode(video=0))
    assert [frame.time for frame in frames] == pytest.approx(times_s, abs=0.002)
    for index, frame in enumerate(frames):
        rgb_ijc = frame.to_ndarray(format="rgb24").astype(int)
        red = np.flatnonzero((rgb_ijc[..., 0] - rgb_ijc[..., 1]).mean(axis=0) > 80)
        assert red.mean() == pytest.approx(20 * index + 7.5, abs=2)
        # The colors are those of the pictures: no wrong matrix, no wrong range.
        assert rgb_ijc[90, 20 * index + 8] == pytest.approx((200, 40, 40), abs=14)
        assert rgb_ijc[90, (20 * index + 160) % WIDTH] == pytest.approx((100, 100, 100), abs=6)
    with av.open(str(path)) as container:
        sound_cn = np.concatenate([frame.to_ndarray() for frame in container.decode(audio=0)], axis=1)
    heard = sound_cn[:, 12_000:36_000]
    spectrum = np.abs(np.fft.rfft(heard[0]))
    assert spectrum.argmax() * 48_000 / heard.shape[1] == pytest.approx(500, abs=5)
    assert heard[0].std() == pytest.approx(0.5 / np.sqrt(2), rel=0.1)
    assert heard[1].std() < 0.02


def test_the_index_comes_first_so_that_playing_starts_at_once(tmp_path: Path) -> None:
    path = tmp_path / "out.mp4"
    with open_video(path, WIDTH, HEIGHT, RATE) as video:
        for index in range(5):
            video.write(picture(index), index / RATE)
    content = path.read_bytes()
    assert 0 < content.index(b"moov") < content.index(b"mdat")


def test_sound_that_ends_early_and_frames_of_one_time_do_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "out.mp4"
    with open_video(path, WIDTH, HEIGHT, RATE, SoundTrack(SAMPLE_RATE, tone(0.2))) as video:
        for index, time_s in enumerate([0.0, 0.1, 0.1, 0.1, 0.4]):
            video.write(picture(index), time_s)
    with av.open(str(path)) as container:
        assert len(list(container.decode(video=0))) == 5


def test_a_stop_in_between_leaves_what_was_there_before(tmp_path: Path) -> None:
    path = tmp_path / "out.mp4"
    path.write_bytes(b"before")
    with pytest.raises(KeyboardInterrupt), open_video(path, WIDTH, HEIGHT, RATE) as video:
        video.write(picture(0), 0.0)
        raise KeyboardInterrupt
    assert [entry.read_bytes() for entry in tmp_path.iterdir()] == [b"before"]


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    path = tmp_path / "gone" / "out.mp4"
    with pytest.raises(OSError, match="No such file") as caught, open_video(path, WIDTH, HEIGHT, RATE) as video:
        video.write(picture(0), 0.0)
    assert caught.value.filename == str(path)


def test_other_names_are_refused() -> None:
    with pytest.raises(InputError, match=r"out\.avi: .* ends in \.mp4 or \.webm"):
        check_video_name(Path("out.avi"))

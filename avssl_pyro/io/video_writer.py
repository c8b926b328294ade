"""Atomic writing of videos with sound, in formats that browsers play."""

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, cast

import av
import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.atomic_file import atomic_replacement
from avssl_pyro.errors import InputError

if TYPE_CHECKING:
    from av.audio.stream import AudioStream
    from av.container import OutputContainer
    from av.video.stream import VideoStream

# Ticks per second of MPEG's clock, so that frame times keep its resolution.
CLOCK = 90_000
KEYFRAMES_S = 2.0
ENCODER_THREADS = 2


@dataclass(frozen=True)
class VideoFormat:
    """A container format with its codecs.

    Args:
        container, video_codec, audio_codec: names in FFmpeg.
        options: settings of the video codec; visually lossless, and fast enough for two cores.
        container_options: settings of the container.
    """

    container: str
    video_codec: str
    audio_codec: str
    options: tuple[tuple[str, str], ...]
    container_options: tuple[tuple[str, str], ...] = ()


FORMATS = {
    # With the index in front, a browser starts to play before the download ends.
    ".mp4": VideoFormat(
        "mp4", "libx264", "aac", (("preset", "superfast"), ("crf", "23")), (("movflags", "+faststart"),)
    ),
    ".webm": VideoFormat(
        "webm",
        "libvpx-vp9",
        "libopus",
        (("deadline", "realtime"), ("cpu-used", "8"), ("row-mt", "1"), ("crf", "33"), ("b", "0")),
    ),
}


@dataclass(frozen=True)
class SoundTrack:
    """Sound track of a video.

    Args:
        sample_rate: sample rate of the blocks in Hz.
        blocks: consecutive blocks from the first frame on, float32 (2, N): left, right.
    """

    sample_rate: int
    blocks: Iterable[npt.NDArray[np.float32]]


def check_video_name(path: Path) -> None:
    """Checks that the name of a video has a format that can be written.

    Raises:
        InputError: the name ends in neither .mp4 nor .webm.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: videos are written as H.264 or VP9; give a name that ends in .mp4 or .webm.")


@contextlib.contextmanager
def open_video(
    path: Path, width: int, height: int, frame_rate: float, sound: SoundTrack | None = None
) -> Iterator["VideoWriter"]:
    """Opens a writer of frames; the file appears when the body ends without error.

    ``.mp4`` becomes H.264 (yuv420p) with AAC, ``.webm`` VP9 with Opus.

    Args:
        path: video file, .mp4 or .webm.
        width, height: size of the frames in pixels, even.
        frame_rate: approximate rate in frames per second; every frame has its own time.
        sound: sound track; None writes a silent video.

    Raises:
        InputError: see :func:`check_video_name`.
        OSError: the file cannot be written; nothing is left behind.
    """
    check_video_name(path)
    with atomic_replacement(path) as temporary:
        kind = FORMATS[path.suffix.lower()]
        try:
            with av.open(str(temporary), "w", format=kind.container, options=dict(kind.container_options)) as container:
                writer = VideoWriter(container, kind, width, height, frame_rate, sound)
                yield writer
                writer.finish()
        except av.FFmpegError as error:
            raise OSError(error.errno, error.strerror, str(path)) from error


class VideoWriter:
    """Writer of frames in order, with interleaved sound; see :func:`open_video`."""

    def __init__(
        self,
        container: "OutputContainer",
        kind: VideoFormat,
        width: int,
        height: int,
        frame_rate: float,
        sound: SoundTrack | None,
    ) -> None:
        self._container = container
        rate = Fraction(frame_rate).limit_denominator(1001)
        video = cast("VideoStream", container.add_stream(kind.video_codec, rate=rate, options=dict(kind.options)))
        video.width, video.height, video.pix_fmt = width, height, "yuv420p"
        video.thread_count = ENCODER_THREADS
        context = video.codec_context
        context.time_base = Fraction(1, CLOCK)
        context.gop_size = max(1, round(KEYFRAMES_S * frame_rate))
        # OpenCV converts to BT.601, limited range. Without these fields players choose by the size of the frames.
        context.colorspace, context.color_range = 5, 1
        self._video = video
        self._last_pts = -1
        self._sound = sound
        self._blocks = iter(sound.blocks if sound is not None else ())
        self._audio: AudioStream | None = None
        if sound is not None:
            self._audio = cast("AudioStream", container.add_stream(kind.audio_codec, rate=48_000, layout="stereo"))
        self._samples = 0

    def write(self, frame_ijc: npt.NDArray[np.uint8], time_s: float) -> None:
        """Writes an RGB frame, (height, width, 3), shown from ``time_s`` seconds on."""
        planes_ij = cv2.cvtColor(frame_ijc, cv2.COLOR_RGB2YUV_I420)
        frame = av.VideoFrame.from_ndarray(np.asarray(planes_ij, dtype=np.uint8), format="yuv420p")
        # Cameras sometimes stamp two frames with one time, which the container rejects.
        self._last_pts = max(round(time_s * CLOCK), self._last_pts + 1)
        frame.pts, frame.time_base = self._last_pts, Fraction(1, CLOCK)
        self._container.mux(self._video.encode(frame))
        self._write_sound(time_s)

    def finish(self) -> None:
        """Flushes the encoders."""
        self._container.mux(self._video.encode())
        self._write_sound(self._last_pts / CLOCK)
        if self._audio is not None:
            self._container.mux(self._audio.encode())

    def _write_sound(self, until_s: float) -> None:
        """Encodes sound up to a time in seconds, interleaved with the frames."""
        if self._sound is None or self._audio is None:
            return
        while self._samples < until_s * self._sound.sample_rate:
            block_cn = next(self._blocks, None)
            if block_cn is None:
                return
            frame = av.AudioFrame.from_ndarray(np.ascontiguousarray(block_cn), format="fltp", layout="stereo")
            frame.sample_rate, frame.pts = self._sound.sample_rate, self._samples
            frame.time_base = Fraction(1, self._sound.sample_rate)
            self._samples += block_cn.shape[1]
            self._container.mux(self._audio.encode(frame))

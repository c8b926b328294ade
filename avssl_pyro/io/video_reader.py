"""A video, read by time stamp: frame rates vary, and frame counts lie."""

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.errors import InputError

# A picture older than this does not show who is heard.
MAX_FRAME_AGE_S = 1.0
# Farther ahead than this, seeking beats decoding what lies between.
_SEEK_AHEAD_S = 5.0
_NEVER = -math.inf
# Times computed as n / rate must not miss frame n by a rounding error.
_ROUNDING_S = 1e-6


class VideoFile:
    """Frames of a video by time; reading forward is fast, jumping back is right.

    Times count from the first frame, by the container's time stamps, so that variable frame rates come out right.
    May be pickled and forked; each process opens the file for itself.

    Args:
        path: any container and codec that OpenCV's FFmpeg reads.

    Raises:
        InputError: it is missing or cannot be read as video.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            raise InputError(f"{path}: no such video file.")
        capture = _open(path)
        self._start(capture)
        self.width = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH))
        self.height = int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        rate = float(capture.get(cv2.CAP_PROP_FPS))
        count = float(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        if not (math.isfinite(rate) and 0.0 < rate <= 1000.0 and count > 0.0 and self.width and self.height):
            raise InputError(f"{path}: holds no readable video frames; give a video such as MP4 with H.264.")
        self.mean_frame_rate = rate
        self.duration_s = count / rate

    def __getstate__(self) -> dict[str, Any]:
        kept = ("path", "width", "height", "mean_frame_rate", "duration_s")
        return {name: self.__dict__[name] for name in kept}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._start(None)

    def frame_at(self, time_s: float) -> npt.NDArray[np.uint8]:
        """The frame that stands at ``time_s``: the last one at or before it, uint8 RGB, (H, W, 3).

        Raises:
            InputError: there is no frame within the second before: a gap, the end, or damage.
        """
        frame_ijc = self.find_frame(time_s)
        if frame_ijc is None:
            raise InputError(
                f"{self.path}: no frame within {MAX_FRAME_AGE_S:g} s before {time_s:.3f} s of {self.duration_s:.3f} s; "
                "the video has a gap there, or ends, or cannot be decoded."
            )
        return frame_ijc

    def find_frame(self, time_s: float) -> npt.NDArray[np.uint8] | None:
        """As :meth:`frame_at`, but None where there is no frame."""
        time_s += _ROUNDING_S
        if time_s < self._time_s or time_s > self._next_s + _SEEK_AHEAD_S:
            self._seek(time_s)
        self._advance(time_s)
        if time_s > self._time_s + MAX_FRAME_AGE_S + 2 * _ROUNDING_S:
            return None
        if self._frame is None and self._time_s > _NEVER:
            # The frames lie farther apart than expected here, and this one was passed by.
            self._seek(self._time_s)
            self._advance(time_s, converted_from_s=_NEVER)
        return self._frame

    def time_stamps(self) -> npt.NDArray[np.float64]:
        """Times of all frames, seconds, ascending, up to the last that can be decoded.

        The container is walked through, and of its frames only the last are decoded: a file that was cut off names
        some that are not whole.
        """
        capture = _open(self.path)
        capture.set(cv2.CAP_PROP_FORMAT, -1)
        times_s, time_s = [], _NEVER
        while capture.grab():
            stamp_s = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
            # Frames are stored in the order of decoding, which jumps forth and back; only all zeros mean no stamps.
            time_s = stamp_s if stamp_s > 0.0 or time_s == _NEVER else time_s + 1.0 / self.mean_frame_rate
            times_s.append(time_s)
        capture.release()
        stamps_s = np.sort(np.array(times_s, dtype=np.float64))
        half_s = 0.5 / self.mean_frame_rate
        while len(stamps_s) and self.find_frame(stamps_s[-1]) is None:
            stamps_s = stamps_s[stamps_s < stamps_s[-1] - MAX_FRAME_AGE_S]
        return stamps_s[stamps_s < self._time_s + half_s]

    def __iter__(self) -> Iterator[tuple[float, npt.NDArray[np.uint8]]]:
        """All frames with their times, seconds; independent of :meth:`frame_at`."""
        capture, time_s = _open(self.path), _NEVER
        try:
            while capture.grab():
                time_s = self._stamp(capture, time_s)
                frame_ijc = _retrieve(capture)
                if frame_ijc is not None:
                    yield time_s, frame_ijc
        finally:
            capture.release()

    def _start(self, capture: cv2.VideoCapture | None) -> None:
        """Sets the state before the first frame: no current frame, and none grabbed ahead."""
        self._capture = capture
        self._time_s, self._next_s = _NEVER, _NEVER
        self._frame: npt.NDArray[np.uint8] | None = None
        self._grabbed = False

    def _seek(self, time_s: float) -> None:
        """Places the reader at some frame at or before ``time_s``; decoders land near where asked, not on it."""
        for margin_s in (1.0, 10.0):
            if time_s > margin_s and self._jump(time_s - margin_s) and self._next_s <= time_s:
                return
        self._start(_open(self.path))

    def _jump(self, time_s: float) -> bool:
        capture = self._capture or _open(self.path)
        self._start(capture)
        capture.set(cv2.CAP_PROP_POS_MSEC, 1e3 * time_s)
        return self._grab(capture)

    def _grab(self, capture: cv2.VideoCapture) -> bool:
        self._grabbed = bool(capture.grab())
        self._next_s = self._stamp(capture, self._next_s) if self._grabbed else math.inf
        return self._grabbed

    def _advance(self, time_s: float, converted_from_s: float | None = None) -> None:
        """Decodes until the next frame lies after ``time_s``, converting colours only of frames near it."""
        capture = self._capture or _open(self.path)
        self._capture = capture
        if converted_from_s is None:
            converted_from_s = time_s - 2.5 / self.mean_frame_rate
        while self._next_s <= time_s:
            if self._grabbed:
                self._take(capture, converted_from_s)
            self._grab(capture)

    def _take(self, capture: cv2.VideoCapture, converted_from_s: float) -> None:
        """Makes the frame that was grabbed ahead the current one, unless it cannot be decoded."""
        if self._next_s < converted_from_s:
            self._time_s, self._frame = self._next_s, None
            return
        frame_ijc = _retrieve(capture)
        if frame_ijc is not None:
            self._time_s, self._frame = self._next_s, frame_ijc

    def _stamp(self, capture: cv2.VideoCapture, previous_s: float) -> float:
        time_s = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
        # Some containers have no time stamps.
        return time_s if time_s > previous_s else previous_s + 1.0 / self.mean_frame_rate


def _open(path: Path) -> cv2.VideoCapture:
    # FFmpeg and OpenCV would print their own complaints beside ours; FFmpeg reads the variable when it is first used.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    try:
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not capture.isOpened():
        raise InputError(
            f"{path}: cannot be read as video; it is truncated, damaged or of an unknown format, so copy or export it "
            "again, as MP4 with H.264 for example."
        )
    return capture


def _retrieve(capture: cv2.VideoCapture) -> npt.NDArray[np.uint8] | None:
    decoded, frame_ijc = capture.retrieve()
    return np.asarray(cv2.cvtColor(frame_ijc, cv2.COLOR_BGR2RGB), dtype=np.uint8) if decoded else None

"""Video frames by time stamp.

Time stamps are used because frame rates vary and the frame counts in containers are unreliable.
"""

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.errors import InputError

# An older frame no longer shows the people who talk at that time.
MAX_FRAME_AGE_S = 1.0
# For larger jumps ahead, seeking is faster than decoding the frames between.
_SEEK_AHEAD_S = 5.0
_NEVER = -math.inf
# Times computed as n / rate must not miss frame n by a rounding error.
_ROUNDING_S = 1e-6


class VideoFile:
    """Reader of video frames by time; fast forward, slower but exact backward.

    Times count from the first frame and follow the container's time stamps, so variable frame rates are supported.
    Readers can be pickled and forked; each process opens the file again.

    Args:
        path: video file, in any container and codec that OpenCV's FFmpeg reads.

    Raises:
        InputError: the file is missing or cannot be read as video.
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
        """Returns the last frame at or before ``time_s``, uint8 RGB, (H, W, 3).

        Raises:
            InputError: there is no frame within the second before, at a gap, after the end or in a damaged part.
        """
        frame_ijc = self.find_frame(time_s)
        if frame_ijc is None:
            raise InputError(
                f"{self.path}: no frame within {MAX_FRAME_AGE_S:g} s before {time_s:.3f} s of {self.duration_s:.3f} s; "
                "the video has a gap there, or ends, or cannot be decoded."
            )
        return frame_ijc

    def find_frame(self, time_s: float) -> npt.NDArray[np.uint8] | None:
        """Returns the frame as :meth:`frame_at` does, or None where there is none."""
        time_s += _ROUNDING_S
        if time_s < self._time_s or time_s > self._next_s + _SEEK_AHEAD_S:
            self._seek(time_s)
        self._advance(time_s)
        if time_s > self._time_s + MAX_FRAME_AGE_S + 2 * _ROUNDING_S:
            return None
        if self._frame is None and self._time_s > _NEVER:
            # Frames are farther apart here than the mean rate suggests, so this one was skipped unconverted.
            self._seek(self._time_s)
            self._advance(time_s, converted_from_s=_NEVER)
        return self._frame

    def time_stamps(self) -> npt.NDArray[np.float64]:
        """Returns the times of all frames in seconds, up to the last decodable one.

        Times ascend. Only the last frames are decoded: the index of a truncated file lists incomplete frames.
        """
        capture = _open(self.path)
        capture.set(cv2.CAP_PROP_FORMAT, -1)
        times_s, time_s = [], _NEVER
        while capture.grab():
            stamp_s = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
            # Frames are stored in decoding order, so stamps are not monotonic; only all zeros mean no stamps.
            time_s = stamp_s if stamp_s > 0.0 or time_s == _NEVER else time_s + 1.0 / self.mean_frame_rate
            times_s.append(time_s)
        capture.release()
        stamps_s = np.sort(np.array(times_s, dtype=np.float64))
        half_s = 0.5 / self.mean_frame_rate
        while len(stamps_s) and self.find_frame(stamps_s[-1]) is None:
            stamps_s = stamps_s[stamps_s < stamps_s[-1] - MAX_FRAME_AGE_S]
        return stamps_s[stamps_s < self._time_s + half_s]

    def __iter__(self) -> Iterator[tuple[float, npt.NDArray[np.uint8]]]:
        """Yields times in seconds and frames, independently of :meth:`frame_at`."""
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
        """Resets the state: no current frame, and none grabbed ahead."""
        self._capture = capture
        self._time_s, self._next_s = _NEVER, _NEVER
        self._frame: npt.NDArray[np.uint8] | None = None
        self._grabbed = False

    def _seek(self, time_s: float) -> None:
        """Moves the reader to a frame at or before ``time_s``; decoders seek inexactly."""
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
        """Decodes up to ``time_s`` and converts colours only of frames near it."""
        capture = self._capture or _open(self.path)
        self._capture = capture
        if converted_from_s is None:
            converted_from_s = time_s - 2.5 / self.mean_frame_rate
        while self._next_s <= time_s:
            if self._grabbed:
                self._take(capture, converted_from_s)
            self._grab(capture)

    def _take(self, capture: cv2.VideoCapture, converted_from_s: float) -> None:
        """Makes the grabbed frame the current one, unless it cannot be decoded."""
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
    # FFmpeg and OpenCV would print messages in addition to ours. FFmpeg reads the variable at its first use.
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

"""Recordings: audio of an array, with or without 360-degree video.

Clips can be read at any time of a recording.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.compatibility import check_channels
from avssl_pyro.clip import IMAGE_COLUMNS, IMAGE_MAX_ELEVATION_DEG, IMAGE_ROWS, SAMPLE_RATE, Clip
from avssl_pyro.errors import InputError
from avssl_pyro.io.audio import AudioFile
from avssl_pyro.io.images import fit_image, is_full_sphere
from avssl_pyro.io.projection_check import check_equirectangular
from avssl_pyro.io.video_reader import VideoFile

_BLOCK_SECONDS = 4.0
_GREY = 128


@dataclass(frozen=True)
class Alignment:
    """Alignment of a recording's picture and channels with the array.

    :class:`Recording` documents the fields.

    >>> Alignment(yaw_deg=90.0, mirror=True).offset_s
    0.0
    """

    offset_s: float = 0.0
    yaw_deg: float = 0.0
    mirror: bool = False
    elevation_range_deg: tuple[float, float] | None = None
    channels: tuple[int, ...] | None = None


@dataclass(frozen=True)
class Recording:
    """A recording of any length, read as clips.

    Times are in seconds of the video, or of the audio where there is no video.

    Args:
        name: prefix of the names of its clips.
        audio: audio file of the array.
        video: equirectangular video; with None, clips have a plain grey image.
        offset_s: audio time minus video time of the same moment; positive when the audio began first.
        yaw_deg: azimuth, seen from the array, of what the centre column of the picture shows; +90 is left.
        mirror: flag of a picture with left and right exchanged; mirroring is undone before the yaw.
        elevation_range_deg: lowest and highest elevation of the picture in degrees. None stands for a full sphere,
            twice as wide as high, or for the proportions of a clip's image, -55 to 55 degrees.
        channels: channels of the audio file, counted from 0, in the order of the microphones; by default all.

    Raises:
        InputError: audio and video do not overlap, a channel does not exist, or the elevation range is invalid.
    """

    name: str
    audio: AudioFile
    video: VideoFile | None = None
    offset_s: float = 0.0
    yaw_deg: float = 0.0
    mirror: bool = False
    elevation_range_deg: tuple[float, float] | None = None
    channels: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        for channel in self.channels or ():
            if not 0 <= channel < self.audio.num_channels:
                raise InputError(
                    f"{self.audio.path}: channel {channel} does not exist; the file has channels 0 to "
                    f"{self.audio.num_channels - 1}."
                )
        if self.elevation_range_deg is not None:
            low, high = self.elevation_range_deg
            if not -90.0 <= low < high <= 90.0:
                raise InputError(
                    f"recording '{self.name}': elevations {low:g} to {high:g} degrees are no range; give the lowest "
                    "and the highest elevation of the picture, between -90 and 90."
                )
        if self.video is not None and self.duration_s <= 0.0:
            raise InputError(
                f"recording '{self.name}': audio ({self.audio.duration_s:.2f} s) and video ({self.video.duration_s:.2f}"
                f" s) have no moment in common at an offset of {self.offset_s:g} s; check the offset."
            )

    @classmethod
    def open(cls, audio: Path, video: Path | None = None, alignment: Alignment | None = None) -> "Recording":
        """Opens the recording of an audio file and, if given, a video file.

        Raises:
            InputError: a file cannot be read, or the two do not fit together.
        """
        alignment = Alignment() if alignment is None else alignment
        return cls(
            audio.stem,
            AudioFile(audio),
            None if video is None else VideoFile(video),
            offset_s=alignment.offset_s,
            yaw_deg=alignment.yaw_deg,
            mirror=alignment.mirror,
            elevation_range_deg=alignment.elevation_range_deg,
            channels=alignment.channels,
        )

    def with_channels_of(self, array: MicrophoneArray) -> "Recording":
        """Returns the recording with the channels of an array.

        Channels that are already set stay; otherwise the array's channel map applies.

        Raises:
            InputError: the channels do not match the array's microphones.
        """
        where, recording = str(self.audio.path), self
        if self.channels is None:
            check_channels(self.audio.num_channels, array, where)
            recording = replace(self, channels=None if array.channels is None else array.channel_indices)
        if recording.num_channels != array.num_microphones:
            raise InputError(
                f"{where}: {recording.num_channels} channel(s) are to be read, but array '{array.name}' has "
                f"{array.num_microphones} microphones; name one channel for each."
            )
        return recording

    @property
    def key(self) -> str:
        """Name as used in clips: letters, digits, '-' and '_' alone."""
        return re.sub(r"[^A-Za-z0-9_-]+", "_", self.name)

    @property
    def num_channels(self) -> int:
        return self.audio.num_channels if self.channels is None else len(self.channels)

    @property
    def start_s(self) -> float:
        """Start in seconds of the interval that audio and video share."""
        return 0.0 if self.video is None else max(0.0, -self.offset_s)

    @property
    def end_s(self) -> float:
        """End in seconds of the interval that audio and video share."""
        if self.video is None:
            return self.audio.duration_s
        return min(self.video.duration_s, self.audio.duration_s - self.offset_s)

    @property
    def duration_s(self) -> float:
        """Duration in seconds of the interval that audio and video share."""
        return self.end_s - self.start_s

    def audio_at(self, start_s: float, duration_s: float = 1.0) -> npt.NDArray[np.float32]:
        """Reads audio from ``start_s`` on, (M, N), in the order of the microphones.

        Raises:
            InputError: see :meth:`AudioFile.read`.
        """
        return self._ordered(self.audio.read_samples(*self._samples(start_s, duration_s)))

    def image_at(self, time_s: float) -> npt.NDArray[np.uint8]:
        """Reads the frame at ``time_s`` as a clip's image, uint8 RGB, (88, 288, 3).

        Raises:
            InputError: there is no frame, see :meth:`VideoFile.frame_at`, or it has unexpected proportions.
        """
        if self.video is None:
            return np.full((IMAGE_ROWS, IMAGE_COLUMNS, 3), _GREY, dtype=np.uint8)
        return self.fit(self.video.frame_at(time_s))

    def fit(self, frame_ijc: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        """Returns a video frame as the image of a clip, (88, 288, 3).

        The image is unmirrored, turned by the yaw and cut to elevations of -55 to 55 degrees.

        Raises:
            InputError: the frame is not wider than high, or is no full sphere although no elevations were given.
        """
        where = self.name if self.video is None else str(self.video.path)
        rows, columns = frame_ijc.shape[:2]
        if columns <= rows:
            raise InputError(
                f"{where}: {columns} x {rows} pixels; a 360-degree picture is wider than high, so this is no "
                "equirectangular one (a fisheye's must be converted), or it was stored on its side."
            )
        if self.elevation_range_deg is not None:
            frame_ijc = _cut_elevations(frame_ijc, self.elevation_range_deg, where)
        if self.mirror:
            frame_ijc = frame_ijc[:, ::-1]
        shift = -round(self.yaw_deg / 360.0 * frame_ijc.shape[1])
        turned_ijc = np.ascontiguousarray(np.roll(frame_ijc, shift, axis=1) if shift else frame_ijc)
        try:
            return fit_image(turned_ijc, where)
        except InputError as error:
            raise InputError(f"{str(error)[:-1]}; otherwise say which elevations it shows.") from error

    def check_picture(self) -> None:
        """Checks the first frame of the video.

        Raises:
            InputError: no frame can be decoded, or the first does not cover 360 degrees, see :meth:`fit`.
        """
        if self.video is None:
            return
        for _, frame_ijc in self.video:
            self.fit(frame_ijc)
            if self.elevation_range_deg is None and is_full_sphere(frame_ijc):
                check_equirectangular(frame_ijc, str(self.video.path))
            return
        raise InputError(f"{self.video.path}: no frame of it can be decoded; export the video again.")

    def clip_at(self, start_s: float, duration_s: float = 1.0) -> Clip:
        """Reads the clip that starts at ``start_s``, with the frame of its middle.

        Raises:
            InputError: see :meth:`audio_at` and :meth:`image_at`.
        """
        image_ijc = self.image_at(start_s + duration_s / 2)
        return Clip(self.key_at(start_s), self.audio_at(start_s, duration_s), image_ijc)

    def windows(self, hop_s: float, duration_s: float = 1.0) -> Iterator[tuple[float, Clip]]:
        """Yields start times and clips in one pass over audio and video.

        Windows without a frame, in a gap or at a damaged end, are left out.

        Args:
            hop_s: time between the starts of consecutive clips in seconds.
            duration_s: length of a clip in seconds.

        Raises:
            InputError: the audio is damaged, or a frame has unexpected proportions.
        """
        for start_s, audio_mn in self.audio_windows(hop_s, duration_s):
            if self.video is None:
                yield start_s, Clip(self.key_at(start_s), audio_mn, self.image_at(start_s))
                continue
            frame_ijc = self.video.find_frame(start_s + duration_s / 2)
            if frame_ijc is not None:
                yield start_s, Clip(self.key_at(start_s), audio_mn, self.fit(frame_ijc))

    def audio_windows(self, hop_s: float, duration_s: float = 1.0) -> Iterator[tuple[float, npt.NDArray[np.float32]]]:
        """Yields start times and audio (M, N), a few seconds in memory at a time.

        Args:
            hop_s: time between the starts of consecutive windows in seconds.
            duration_s: length of a window in seconds.

        Raises:
            InputError: the audio is damaged.
        """
        held_mn, held_from = np.zeros((self.audio.num_channels, 0), np.float32), 0
        for start_s in self.window_starts(hop_s, duration_s):
            first, count = self._samples(start_s, duration_s)
            held_mn, held_from = held_mn[:, max(0, first - held_from) :], max(held_from, first)
            if held_from + held_mn.shape[1] < first + count:
                held_mn, held_from = held_mn if held_from == first else held_mn[:, :0], first
                begin = first + held_mn.shape[1]
                size = max(round(_BLOCK_SECONDS * SAMPLE_RATE), first + count - begin)
                read_mn = self.audio.read_samples(begin, min(size, self.audio.num_samples - begin))
                held_mn = np.concatenate([held_mn, read_mn], axis=1)
            yield start_s, self._ordered(held_mn[:, :count])

    def window_starts(self, hop_s: float, duration_s: float = 1.0) -> list[float]:
        """Returns start times of windows in seconds; none in a shorter recording.

        Raises:
            InputError: ``hop_s`` or ``duration_s`` is not positive.
        """
        if not (hop_s > 0.0 and duration_s > 0.0):
            raise InputError(f"a window of {duration_s:g} s every {hop_s:g} s is impossible; both must be positive.")
        # Rounding can leave the interval a sample short, and it still holds the last window.
        count = int(np.floor((self.duration_s - duration_s) / hop_s + 1e-6)) + 1
        starts_s = [self.start_s + number * hop_s for number in range(max(0, count))]
        return [start_s for start_s in starts_s if sum(self._samples(start_s, duration_s)) <= self.audio.num_samples]

    def key_at(self, start_s: float) -> str:
        """Returns the name of the clip at ``start_s``: recording and milliseconds."""
        return f"{self.key}-{round(1e3 * start_s):08d}"

    def _samples(self, start_s: float, duration_s: float) -> tuple[int, int]:
        return round((start_s + self.offset_s) * SAMPLE_RATE), round(duration_s * SAMPLE_RATE)

    def _ordered(self, audio_mn: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        return np.array(audio_mn if self.channels is None else audio_mn[list(self.channels)], order="C")


def _cut_elevations(
    frame_ijc: npt.NDArray[np.uint8], elevation_range_deg: tuple[float, float], where: str
) -> npt.NDArray[np.uint8]:
    """Cuts or pads a picture with known elevations to -55..55 degrees.

    The result has the proportions of a clip's image.
    """
    rows, columns = frame_ijc.shape[:2]
    low, high = elevation_range_deg
    rows_per_degree = rows / (high - low)
    top = round((high - IMAGE_MAX_ELEVATION_DEG) * rows_per_degree)
    bottom = round((-IMAGE_MAX_ELEVATION_DEG - low) * rows_per_degree)
    cut_ijc = frame_ijc[max(0, top) : rows - max(0, bottom)]
    if not len(cut_ijc):
        raise InputError(f"{where}: elevations {low:g} to {high:g} degrees show nothing between -55 and 55 degrees.")
    padded_ijc = cv2.copyMakeBorder(cut_ijc, max(0, -top), max(0, -bottom), 0, 0, cv2.BORDER_CONSTANT)
    height = round(columns * IMAGE_ROWS / IMAGE_COLUMNS)
    return np.asarray(cv2.resize(padded_ijc, (columns, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)

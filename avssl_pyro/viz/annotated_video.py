"""Annotated video of a recording: frames with the localized sources, and stereo sound."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.errors import InputError
from avssl_pyro.io.video_writer import SoundTrack, open_video
from avssl_pyro.recordings.recording import Recording
from avssl_pyro.tracking.timeline import Timeline
from avssl_pyro.viz.frame_annotator import AnnotationStyle, FrameAnnotator

# Sound is read in pieces of this many samples.
BLOCK = SAMPLE_RATE


def save_annotated_video(
    path: Path,
    recording: Recording,
    timeline: Timeline,
    array: MicrophoneArray,
    *,
    show_spread: bool = False,
    on_frame: Callable[[float], None] = lambda _time_s: None,
) -> None:
    """Writes every frame of a recording at its time, annotated with the active sources.

    Frames are neither rotated nor mirrored; markers and ruler follow the recording's yaw and mirror instead. The left
    and right channels are the leftmost and the rightmost microphone.

    Args:
        path: video file, see :func:`avssl_pyro.io.video_writer.open_video`.
        recording: recording with video.
        timeline: sources of the recording over time.
        array: microphones of the recording.
        show_spread: True draws standard deviations.
        on_frame: function called with the time of every frame, seconds; an exception ends the writing without a file.

    Raises:
        InputError: the recording has no video, or see :func:`avssl_pyro.io.video_writer.open_video`.
        OSError: the file cannot be written; nothing is left behind.
    """
    video = recording.video
    if video is None:
        raise InputError(f"{path}: recording '{recording.name}' has no video; give a recording with one.")
    style = AnnotationStyle(float(np.deg2rad(recording.yaw_deg)), recording.mirror, show_spread)
    annotator = FrameAnnotator(video.height, video.width, timeline, style)
    sound = SoundTrack(SAMPLE_RATE, _sound(recording, stereo_pair(array)))
    with open_video(path, annotator.width, annotator.height, video.mean_frame_rate, sound) as out:
        for time_s, frame_ijc in video:
            out.write(annotator.draw(frame_ijc, time_s), time_s)
            on_frame(time_s)


def stereo_pair(array: MicrophoneArray) -> tuple[int, int]:
    """Returns the leftmost and the rightmost microphone, or twice the first if all are equally far left.

    Sums of more microphones would lose high frequencies, as sound reaches them at different times.
    """
    left_m = array.positions[:, 1]
    return (int(left_m.argmax()), int(left_m.argmin())) if left_m.size else (0, 0)


def _sound(recording: Recording, pair: tuple[int, int]) -> Iterator[npt.NDArray[np.float32]]:
    """Yields blocks of stereo sound, (2, N), from the first frame on, with silence before the audio begins."""
    if recording.start_s > 0:
        yield np.zeros((2, round(recording.start_s * SAMPLE_RATE)), np.float32)
    first, end = (round((time_s + recording.offset_s) * SAMPLE_RATE) for time_s in (recording.start_s, recording.end_s))
    # The last sample may be missing by rounding.
    for start in range(first, min(end, recording.audio.num_samples), BLOCK):
        count = min(BLOCK, end - start, recording.audio.num_samples - start)
        audio_mn = recording.audio_at(start / SAMPLE_RATE - recording.offset_s, count / SAMPLE_RATE)
        yield np.clip(audio_mn[list(pair)], -1.0, 1.0)

"""Samples of a recording for its checks: the first minute of its video, and clips from all over it."""

import cv2
import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from avssl_pyro.clip import SAMPLE_RATE, Clip
from avssl_pyro.diagnosis.finding import Finding
from avssl_pyro.diagnosis.synchronization import check_lag, picture_change, sound_energy
from avssl_pyro.errors import InputError
from avssl_pyro.io.video_reader import VideoFile
from avssl_pyro.recordings.excerpts import MOST_EXCERPTS, evenly
from avssl_pyro.recordings.recording import Recording

# Sound and picture are compared over this many seconds, in frames of this many columns and rows.
LAG_SECONDS = 60.0
LAG_PICTURE = (96, 48)


def check_recording_lag(recording: Recording, video: VideoFile, progress: bool = False) -> tuple[Finding, ...]:
    """Offset of sound and picture, from onsets in the first minute that audio and video have in common.

    Args:
        recording: audio and its position in time.
        video: video of the recording.
        progress: show a progress bar.

    Raises:
        InputError: the video has fewer than two frames in that minute.
    """
    start_s, seconds = recording.start_s, min(LAG_SECONDS, recording.duration_s)
    times_s: list[float] = []
    images: list[npt.NDArray[np.uint8]] = []
    with tqdm(total=round(seconds), unit="s", desc="reading the video", disable=not progress) as bar:
        for time_s, frame_ijc in video:
            if time_s > start_s + seconds:
                break
            if time_s >= start_s:
                bar.update(min(round(time_s - start_s), bar.total) - bar.n)
                times_s.append(time_s - start_s)
                small_ijc = cv2.resize(frame_ijc, LAG_PICTURE, interpolation=cv2.INTER_AREA)
                images.append(np.asarray(small_ijc, dtype=np.uint8))
    if len(times_s) < 2:
        raise InputError(f"{video.path}: fewer than two frames can be read from {start_s:.1f} s on.")
    change_t = picture_change(np.array(times_s), np.stack(images), seconds)
    energy_t = sound_energy(recording.audio_at(start_s, seconds), SAMPLE_RATE)
    return check_lag(energy_t, change_t, recording.offset_s)


def spread_clips(recording: Recording, still_ijc: npt.NDArray[np.uint8] | None = None) -> list[Clip]:
    """Clips of one second spread evenly over a recording; those without a picture are left out.

    Args:
        recording: recording with a video, or without one.
        still_ijc: image in place of a video, as a clip has it, (88, 288, 3).
    """
    starts_s = recording.window_starts(hop_s=1.0)
    clips = []
    for start_s in (starts_s[index] for index in evenly(len(starts_s), MOST_EXCERPTS)):
        image_ijc = still_ijc
        if recording.video is not None:
            frame_ijc = recording.video.find_frame(start_s + 0.5)
            image_ijc = None if frame_ijc is None else recording.fit(frame_ijc)
        # A gap in the video shows nobody.
        if image_ijc is not None:
            clips.append(Clip(recording.key_at(start_s), recording.audio_at(start_s), image_ijc))
    return clips

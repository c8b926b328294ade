"""Candidate clips of recordings: their loudness, and whether they have a picture."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from avssl_pyro.errors import InputError
from avssl_pyro.io.video_reader import MAX_FRAME_AGE_S
from avssl_pyro.recordings.recording import Recording

# -100 dB of full scale; below, a channel holds only rounding noise.
SILENT_RMS = 1e-5
_SAME_LENGTH_S = 0.5


@dataclass(frozen=True)
class ClipCandidate:
    """A possible clip of a recording.

    Args:
        recording: index of the recording.
        start_s: start of the clip in seconds.
        rms: RMS of the audio relative to full scale.
    """

    recording: int
    start_s: float
    rms: float


@dataclass(frozen=True)
class Survey:
    """Candidates that have sound and a picture.

    Args:
        places: candidates, ordered by recording and time.
        remarks: sentences on the clips and recordings that were left out.
    """

    places: tuple[ClipCandidate, ...]
    remarks: tuple[str, ...]

    def loudest(self, count: int | None) -> tuple[ClipCandidate, ...]:
        """Returns the ``count`` loudest candidates (None: all), ordered by time.

        Among equally loud candidates the earlier ones are taken.
        """
        order = np.argsort([-place.rms for place in self.places], kind="stable")[:count]
        return tuple(self.places[index] for index in np.sort(order))


def survey(recordings: Sequence[Recording], hop_s: float, duration_s: float, progress: bool = True) -> Survey:
    """Returns the candidates of recordings in one pass over the audio.

    Of videos, only the time stamps are read.

    Args:
        recordings: recordings to cut.
        hop_s: time between the starts of consecutive clips in seconds.
        duration_s: length of a clip in seconds.
        progress: switch of the progress bar.

    Raises:
        InputError: a file is damaged, or no clip of any recording has both sound and a picture.
    """
    places: list[ClipCandidate] = []
    remarks: list[str] = []
    total_s = math.floor(sum(recording.duration_s for recording in recordings))
    with tqdm(total=total_s, desc="listening", unit="s", disable=not progress) as bar:
        for number, recording in enumerate(recordings):
            found, left_out = _survey_one(number, recording, hop_s, duration_s, bar)
            places += found
            remarks += left_out
    if not places:
        floor_db = 20 * math.log10(SILENT_RMS)
        raise InputError(
            f"no clip of {duration_s:g} s has both sound above {floor_db:.0f} dB of full scale and a picture; "
            f"check channels and offset ({' '.join(remarks).removesuffix('.') or 'recordings too short'})."
        )
    return Survey(tuple(places), tuple(remarks))


def _survey_one(
    number: int, recording: Recording, hop_s: float, duration_s: float, bar: "tqdm[None]"
) -> tuple[list[ClipCandidate], list[str]]:
    if recording.video is None:
        return [], [f"{recording.name}: has no video; it is left out."]
    remarks = list(_length_remarks(recording, recording.video.duration_s, duration_s))
    stamps_s = recording.video.time_stamps()
    places, silent, unseen = [], 0, []
    for start_s, audio_mn in recording.audio_windows(hop_s, duration_s):
        rms = loudness(audio_mn)
        if rms < SILENT_RMS:
            silent += 1
        elif not _has_picture(stamps_s, start_s + duration_s / 2):
            unseen.append(start_s)
        else:
            places.append(ClipCandidate(number, start_s, rms))
        bar.update(min(hop_s, max(0.0, bar.total - bar.n)))
    if unseen:
        remarks.append(
            f"{recording.name}: {len(unseen)} clip(s) have no picture, the first at {unseen[0]:.1f} s, where the video "
            "has a gap or ends; they are left out."
        )
    if silent:
        remarks.append(f"{recording.name}: {silent} clip(s) are silent; they are left out.")
    return places, remarks


def loudness(audio_mn: npt.NDArray[np.float32]) -> float:
    """Returns the RMS over channels and samples, without each channel's mean."""
    return math.sqrt(float(audio_mn.var(axis=1, dtype=np.float64).mean()))


def _has_picture(stamps_s: npt.NDArray[np.float64], time_s: float) -> bool:
    latest = int(np.searchsorted(stamps_s, time_s, side="right")) - 1
    return latest >= 0 and time_s - stamps_s[latest] <= MAX_FRAME_AGE_S


def _length_remarks(recording: Recording, video_s: float, duration_s: float) -> list[str]:
    if recording.duration_s < duration_s:
        return [f"{recording.name}: audio and video share {recording.duration_s:.2f} s, less than a clip."]
    audio_s = recording.audio.duration_s
    if abs(audio_s - video_s) > _SAME_LENGTH_S:
        return [
            f"{recording.name}: its audio lasts {audio_s:.2f} s, its video {video_s:.2f} s; the "
            f"{recording.duration_s:.2f} s that both have are used."
        ]
    return []

"""Localization of a whole recording, window by window."""

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.channel_gains import ChannelGains
from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.interruption import GracefulInterrupt
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.recordings.excerpts import read_excerpts
from avssl_pyro.recordings.preparation import open_for_array
from avssl_pyro.recordings.recording import Alignment, Recording
from avssl_pyro.tracking.timeline import Timeline, timeline_of_tracks, timeline_of_windows
from avssl_pyro.tracking.tracker import WindowDetections, track

WINDOW_S = 1.0
ONE_PASS_RATE_HZ, REFINED_RATE_HZ = 10.0, 2.0
# Number of windows that are held in memory and localized together.
BATCH = 8


def default_rate_hz(refined: bool) -> float:
    """Returns the results per second whose computation takes about real time."""
    return REFINED_RATE_HZ if refined else ONE_PASS_RATE_HZ


def open_recording(audio: Path, video: Path | None, array: MicrophoneArray, alignment: Alignment) -> Recording:
    """Opens and checks the recording of an array.

    Args:
        audio: WAV or FLAC file of any rate, one channel per microphone.
        video: equirectangular video; None for audio alone.
        array: microphone array of the recording.
        alignment: position of picture and channels relative to the array.

    Raises:
        InputError: a file cannot be read, audio and video overlap by less than a window, the number of channels is not
            that of the array, a channel is dead, or the picture is not equirectangular.
    """
    recording = Recording.open(audio, video, alignment)
    if recording.duration_s < WINDOW_S:
        raise InputError(
            f"{audio}: sound and picture have {recording.duration_s:.2f} s in common; a result needs {WINDOW_S:g} s."
        )
    return open_for_array(recording, array)


def recording_gains(recording: Recording, localizer: Localizer) -> ChannelGains:
    """Gains of the channels over the whole recording, from its excerpts, unless the localizer has them.

    Args:
        recording: audio of an array.
        localizer: localizer of the same array.

    Raises:
        InputError: the audio cannot be read.
    """
    if localizer.gains is not None:
        return localizer.gains
    excerpts = read_excerpts(recording.audio.path)
    channels = range(excerpts.num_channels) if recording.channels is None else recording.channels
    return localizer.gains_of(excerpts.select(channels).audio_bmn)


def localize_recording(
    recording: Recording,
    localizer: Localizer,
    *,
    rate_hz: float = REFINED_RATE_HZ,
    tracking: bool = True,
    interrupt: GracefulInterrupt | None = None,
    progress: bool = False,
) -> Timeline:
    """Localizes a recording window by window and returns the timeline of its sources.

    Gains of the channels are estimated once, over the whole recording, unless the localizer has them already.

    Args:
        recording: audio of an array, with or without video.
        localizer: localizer of the windows.
        rate_hz: number of results per second, each from one second of audio.
        tracking: flag for linking the results into tracks, which keep their numbers and bridge short misses.
        interrupt: request to stop; the timeline then ends with the current window.
        progress: flag for a progress bar.

    Raises:
        InputError: ``rate_hz`` is out of range, the recording's channels are not those of the localizer's array, or
            the audio is damaged.
    """
    if not 0 < rate_hz <= 100:
        raise InputError(f"the rate is {rate_hz:g}; give a number of results per second, above 0 and up to 100.")
    hop_s = 1 / rate_hz
    localizer = localizer.with_gains(recording_gains(recording, localizer))
    windows: list[WindowDetections] = []
    with tqdm(
        total=len(recording.window_starts(hop_s, WINDOW_S)), unit="window", desc="localizing", disable=not progress
    ) as bar:
        for window in localize_windows(recording.windows(hop_s, WINDOW_S), localizer):
            windows.append(window)
            bar.update()
            if interrupt is not None and interrupt.requested:
                break
    if tracking:
        return timeline_of_tracks(windows, track(windows), hop_s, WINDOW_S / 2)
    return timeline_of_windows(windows, hop_s, WINDOW_S / 2)


def localize_windows(
    windows: Iterable[tuple[float, Clip]], localizer: Localizer, window_s: float = WINDOW_S
) -> Iterator[WindowDetections]:
    """Sources of windows in order, a few windows in memory at a time; each is dated at the middle of its window.

    Args:
        windows: start times in seconds, and clips of equal length.
        localizer: localizer of the clips.
        window_s: length of the clips in seconds.
    """
    windows = iter(windows)
    while batch := list(islice(windows, BATCH)):
        found = localizer.localize([clip for _, clip in batch])
        for (start_s, _), localization in zip(batch, found, strict=True):
            yield WindowDetections(start_s + window_s / 2, localization.sources)

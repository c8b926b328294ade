"""Localizes the sounding objects of a whole recording: the part of localize.py that takes a video."""

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.cli.command import EXIT_INTERRUPTED
from avssl_pyro.cli.options import AlignmentOptions
from avssl_pyro.errors import InputError
from avssl_pyro.interruption import GracefulInterrupt
from avssl_pyro.io.dcase import write_dcase
from avssl_pyro.io.video_writer import check_video_name, has_encoder
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.localization.posterior import SourceThresholds
from avssl_pyro.recordings.discovery import RecordingFiles
from avssl_pyro.recordings.excerpts import read_excerpts
from avssl_pyro.recordings.recording import Recording
from avssl_pyro.tracking.results import dcase_rows, json_lines
from avssl_pyro.tracking.timeline import Timeline, timeline_of_tracks, timeline_of_windows
from avssl_pyro.tracking.tracker import WindowDetections, track
from avssl_pyro.tracking.window_stream import detect
from avssl_pyro.viz.annotated_video import save_annotated_video

WINDOW_S = 1.0
FAST_RATE, REFINED_RATE = 10.0, 2.0
BAR_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s [{elapsed}<{remaining}]"


@dataclass(frozen=True)
class RecordingOptions:
    """What is asked of a whole recording."""

    video: Path | None = None
    """Instead of --image: equirectangular video of the whole recording, of any size and frame rate."""
    dcase: Path | None = None
    """With --video: CSV file to write in DCASE's form, frames of 100 ms."""
    annotated: Path | None = None
    """With --video: the video with its sources drawn in, to be written: .mp4 (H.264) or .webm (VP9)."""
    rate: float | None = None
    """With --video: results per second, each of one second of sound; by default 2, or 10 with --rounds 0."""
    tracking: bool = True
    """With --video: link the results over time, so that a source keeps its number and a short miss is bridged."""
    placement: Annotated[AlignmentOptions, tyro.conf.arg(name="")] = field(default_factory=AlignmentOptions)

    def check_unused(self) -> None:
        """Refuses options of recordings where there is none.

        Raises:
            InputError: one of them was given.
        """
        for name in ("dcase", "annotated", "rate"):
            if getattr(self, name) is not None:
                raise InputError(f"--{name} is for whole recordings; give --video with --audio.")


def open_recording(options: RecordingOptions, audio: Path, array: MicrophoneArray) -> Recording:
    """The recording that the options name.

    Raises:
        InputError: a file cannot be read, audio and video have no second in common, the number of channels is not
            that of the system's array, one of them is dead, or the picture is none of 360 degrees.
    """
    if options.video is None:
        raise InputError("a recording has no video; give --video with --audio.")
    recording = RecordingFiles(options.video, audio, options.placement.of(array)).open()
    if recording.num_channels != array.num_microphones:
        raise InputError(
            f"{audio}: {recording.num_channels} channel(s), but array '{array.name}' has {array.num_microphones} "
            "microphones; give a recording of that array, or an array file with the 'channels' of its microphones."
        )
    if recording.duration_s < WINDOW_S:
        raise InputError(
            f"{audio}: sound and picture have {recording.duration_s:.2f} s in common; a result needs {WINDOW_S:g} s."
        )
    recording.check_picture()
    read_excerpts(audio).select(array.channel_indices).check_live(audio)
    return recording


def check_outputs(outputs: Sequence[Path | None], inputs: Sequence[Path | None]) -> None:
    """Finds out before the long work whether its results can be written; makes their folders.

    Raises:
        InputError: an output is no regular file, or would replace an input or another output.
        OSError: its folder cannot be made or written.
    """
    taken = [path.resolve() for path in inputs if path is not None]
    for path in outputs:
        if path is None:
            continue
        if path.resolve() in taken:
            raise InputError(f"{path}: is read or written by the same command already; give every output its own name.")
        taken.append(path.resolve())
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: is not a regular file; name a file that may be made or replaced.")
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass


def localize_recording(
    options: RecordingOptions,
    audio: Path,
    out: Path,
    array: MicrophoneArray,
    localizer: Localizer,
    thresholds: SourceThresholds,
    refined: bool,
) -> int:
    """Localizes window by window, links the results, and writes what was asked for.

    Ctrl-C ends the first part early: the files then hold whole results up to there, and no video is drawn.

    Args:
        options: of the recording.
        audio: one channel per microphone.
        out: JSON lines.
        array: the microphones that recorded; it knows their channels.
        localizer, thresholds: how.
        refined: whether the localizer refines.

    Returns:
        The exit code.

    Raises:
        InputError, OSError: before anything is written, if the input or an output is at fault.
    """
    rate = options.rate if options.rate is not None else REFINED_RATE if refined else FAST_RATE
    if not 0 < rate <= 100:
        raise InputError(f"--rate is {rate:g}; give a number of results per second, above 0 and up to 100.")
    recording = open_recording(options, audio, array)
    if options.annotated is not None:
        check_video_name(options.annotated)
    check_outputs((out, options.dcase, options.annotated), (audio, options.video))
    if options.annotated is not None and not has_encoder():
        print(
            "note: without PyAV the video is MPEG-4 Part 2 without sound, which browsers do not play; "
            "pip install 'avssl-pyro[video]' for H.264.",
            file=sys.stderr,
        )
    with GracefulInterrupt() as stop:
        windows = _localize(recording, localizer, thresholds, 1 / rate, stop)
        timeline = _timeline(windows, options.tracking, 1 / rate)
        write_atomically(out, json_lines(timeline, "track" if options.tracking else "source_class").encode())
        if options.dcase is not None:
            end_s = windows[-1].time_s + WINDOW_S / 2 if stop.requested and windows else recording.end_s
            write_dcase(options.dcase, dcase_rows(timeline, end_s))
        if stop.requested:
            reached_s = windows[-1].time_s + WINDOW_S / 2 if windows else recording.start_s
            print(
                f"interrupted at {reached_s:.1f} s of {recording.end_s:.1f} s; {out} holds the {len(windows)} results "
                "up to there, and the same command begins anew.",
                file=sys.stderr,
            )
            return EXIT_INTERRUPTED
        unseen = len(recording.window_starts(1 / rate, WINDOW_S)) - len(windows)
        if unseen:
            print(
                f"warning: {options.video}: {unseen} windows have no picture, where the video has a gap or ends; they "
                "have no result.",
                file=sys.stderr,
            )
        print(_summary(timeline, recording.duration_s, options.tracking))
        if options.annotated is not None and not _draw(
            options.annotated, recording, timeline, localizer, refined, stop
        ):
            print(f"interrupted; {options.annotated} was not written, {out} is whole.", file=sys.stderr)
            return EXIT_INTERRUPTED
    return 0


def _localize(
    recording: Recording, localizer: Localizer, thresholds: SourceThresholds, hop_s: float, stop: GracefulInterrupt
) -> list[WindowDetections]:
    total = len(recording.window_starts(hop_s, WINDOW_S))
    found: list[WindowDetections] = []
    with tqdm(total=total, unit="window", desc="localizing") as bar:
        for window in detect(recording.windows(hop_s, WINDOW_S), localizer, thresholds, duration_s=WINDOW_S):
            found.append(window)
            bar.update()
            if stop.requested:
                break
    return found


def _timeline(windows: Sequence[WindowDetections], tracking: bool, hop_s: float) -> Timeline:
    if tracking:
        return timeline_of_tracks(windows, track(windows), hop_s, WINDOW_S / 2)
    return timeline_of_windows(windows, hop_s, WINDOW_S / 2)


def _draw(
    path: Path, recording: Recording, timeline: Timeline, localizer: Localizer, refined: bool, stop: GracefulInterrupt
) -> bool:
    """Draws the annotated video; False if that was interrupted, and no video is there."""
    with tqdm(total=round(recording.end_s, 1), unit="s", desc="drawing", bar_format=BAR_FORMAT) as bar:

        def on_frame(time_s: float) -> None:
            bar.update(max(0.0, min(time_s, bar.total) - bar.n))
            if stop.requested:
                raise KeyboardInterrupt

        try:
            save_annotated_video(
                path, recording, timeline, localizer.config.array, show_spread=refined, on_frame=on_frame
            )
        except KeyboardInterrupt:
            return False
    return True


def _summary(timeline: Timeline, duration_s: float, tracking: bool) -> str:
    """One sentence on what was found."""
    sounding = sum(bool(moment.sources) for moment in timeline.moments)
    share = 100 * sounding / max(1, len(timeline.moments))
    what = f"{len(timeline.names)} source(s)" if tracking else f"sources of {len(timeline.names)} class(es)"
    return (
        f"{len(timeline.moments)} results over {duration_s:.1f} s: {what}; something sounds in {share:.0f} % of them."
    )

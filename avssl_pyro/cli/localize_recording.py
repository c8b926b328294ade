"""The part of ``avssl localize`` that takes a whole recording."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from avssl_pyro.cli.command import EXIT_INTERRUPTED
from avssl_pyro.cli.options import AlignmentOptions
from avssl_pyro.cli.outputs import check_outputs
from avssl_pyro.errors import InputError

if TYPE_CHECKING:
    from avssl_pyro.acoustics.array import MicrophoneArray
    from avssl_pyro.acoustics.channel_gains import ChannelGains
    from avssl_pyro.interruption import GracefulInterrupt
    from avssl_pyro.localization.localizer import Localizer
    from avssl_pyro.recordings.recording import Recording
    from avssl_pyro.tracking.timeline import Timeline

BAR_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s [{elapsed}<{remaining}]"


@dataclass(frozen=True)
class RecordingOptions:
    """Options of a whole recording."""

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
    alignment: Annotated[AlignmentOptions, tyro.conf.arg(name="")] = field(default_factory=AlignmentOptions)

    def check_unused(self) -> None:
        """Refuses options of recordings where there is none.

        Raises:
            InputError: one of them was given.
        """
        for name in ("dcase", "annotated", "rate"):
            if getattr(self, name) is not None:
                raise InputError(f"--{name} is for whole recordings; give --video with --audio.")
        if not self.tracking:
            raise InputError("--no-tracking is for whole recordings; give --video with --audio.")
        for name in ("offset", "yaw", "mirror", "elevations"):
            if getattr(self.alignment, name) != getattr(AlignmentOptions(), name):
                raise InputError(f"--{name} is for whole recordings; give --video, or turn the picture beforehand.")


def warn_of_gains(gains: "ChannelGains", source: Path, array: "MicrophoneArray") -> None:
    """Prints one warning for every channel that is dead, or whose gain or sign differs.

    Args:
        gains: gains of the channels, in the order of the microphones.
        source: file of the clip, the list or the recording.
        array: array that recorded, with its channels.
    """
    for remark in gains.remarks(array.channel_indices):
        print(f"warning: {source}: {remark}; 'avssl doctor' checks the channels.", file=sys.stderr)


def localize_recording(
    options: RecordingOptions,
    audio: Path,
    out: Path | None,
    array: "MicrophoneArray",
    localizer: "Localizer",
    refined: bool,
) -> int:
    """Localizes a recording, writes what was asked for, and prints a summary.

    Ctrl-C ends the first part early: the files then hold whole results up to there, and no video is drawn.

    Args:
        options: options of the recording.
        audio: audio file, one channel per microphone.
        out: file of JSON lines; None for standard output.
        array: array that recorded, with its channels.
        localizer: localizer of the windows.
        refined: whether the localizer refines.

    Returns:
        The exit code.

    Raises:
        InputError, OSError: before anything is written, if the input or an output is at fault.
    """
    from avssl_pyro.interruption import GracefulInterrupt
    from avssl_pyro.io.video_writer import check_video_name
    from avssl_pyro.tracking import recording_localizer as library

    rate = options.rate if options.rate is not None else library.default_rate_hz(refined)
    if not 0 < rate <= 100:
        raise InputError(f"--rate is {rate:g}; give a number of results per second, above 0 and up to 100.")
    recording = library.open_recording(audio, options.video, array, options.alignment.of(array))
    if options.annotated is not None:
        check_video_name(options.annotated)
    check_outputs((out, options.dcase, options.annotated), (audio, options.video))
    gains = library.recording_gains(recording, localizer)
    warn_of_gains(gains, audio, array)
    localizer = localizer.with_gains(gains)
    with GracefulInterrupt() as stop:
        timeline = library.localize_recording(
            recording, localizer, rate_hz=rate, tracking=options.tracking, interrupt=stop, progress=True
        )
        reached_s = timeline.frames[-1].time_s + library.WINDOW_S / 2 if timeline.frames else recording.start_s
        _write(timeline, options, out, reached_s if stop.requested else recording.end_s)
        if stop.requested:
            kept = f"{out} holds the {len(timeline.frames)} results up to there, and " if out is not None else ""
            print(
                f"interrupted at {reached_s:.1f} s of {recording.end_s:.1f} s; {kept}the same command begins anew.",
                file=sys.stderr,
            )
            return EXIT_INTERRUPTED
        unseen = len(recording.window_starts(1 / rate, library.WINDOW_S)) - len(timeline.frames)
        if unseen:
            print(
                f"warning: {options.video}: {unseen} windows have no picture, where the video has a gap or ends; they "
                "have no result.",
                file=sys.stderr,
            )
        summary = _summary(timeline, recording.duration_s, options.tracking)
        print(summary, file=sys.stdout if out is not None else sys.stderr)
        if options.annotated is not None and not _draw(
            options.annotated, recording, timeline, localizer, refined, stop
        ):
            print(f"interrupted; {options.annotated} was not written, the results are whole.", file=sys.stderr)
            return EXIT_INTERRUPTED
    return 0


def _write(timeline: "Timeline", options: RecordingOptions, out: Path | None, end_s: float) -> None:
    from avssl_pyro.atomic_file import write_atomically
    from avssl_pyro.io.dcase import write_dcase
    from avssl_pyro.tracking.results import dcase_rows, json_lines

    lines = json_lines(timeline, "track" if options.tracking else "source_class")
    if out is None:
        sys.stdout.write(lines)
    else:
        write_atomically(out, lines.encode())
    if options.dcase is not None:
        write_dcase(options.dcase, dcase_rows(timeline, end_s))


def _draw(
    path: Path,
    recording: "Recording",
    timeline: "Timeline",
    localizer: "Localizer",
    refined: bool,
    stop: "GracefulInterrupt",
) -> bool:
    """Draws the annotated video; False if that was interrupted, and no video is there."""
    from tqdm import tqdm

    from avssl_pyro.viz.annotated_video import save_annotated_video

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


def _summary(timeline: "Timeline", duration_s: float, tracking: bool) -> str:
    """One sentence on what was found."""
    sounding = sum(bool(moment.sources) for moment in timeline.frames)
    share = 100 * sounding / max(1, len(timeline.frames))
    what = f"{len(timeline.names)} source(s)" if tracking else f"sources of {len(timeline.names)} class(es)"
    return f"{len(timeline.frames)} results over {duration_s:.1f} s: {what}; something sounds in {share:.0f} % of them."

"""Cuts recordings into clips to train on."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from avssl_pyro.cli.options import AlignmentOptions, parse_options
from avssl_pyro.errors import InputError
from avssl_pyro.io.dcase import DcaseRow

if TYPE_CHECKING:
    from avssl_pyro.acoustics.array import MicrophoneArray
    from avssl_pyro.recordings.discovery import RecordingFiles
    from avssl_pyro.recordings.preparation import Prepared
    from avssl_pyro.recordings.recording import Recording
    from avssl_pyro.recordings.split import Splitter


@dataclass(frozen=True)
class PrepareOptions:
    """Cut the loudest clips, each with a picture, out of recordings: shards for svi_train.py --data.

    Give one recording (--video and --audio), a --folder of them, a --manifest, or a copy of STARSS23 (--starss). Any
    length, rate and channel count will do; killed at any moment, the same command goes on.
    """

    out: Path
    """Folder to write to; with --validation, its sub-folders train and validation."""
    array: str | None = None
    """Microphone array: a preset or a YAML file; for STARSS23 by default its own."""
    video: Path | None = None
    """360-degree video of one recording, equirectangular, any frame rate."""
    audio: Path | None = None
    """Audio of one recording: WAV or FLAC, any rate."""
    folder: Path | None = None
    """Folder of recordings: a video and an audio file of the same name for each."""
    manifest: Annotated[Path | None, tyro.conf.arg(metavar="FILE.csv")] = None
    """CSV file with columns video,audio and if wanted offset_s,yaw_deg; file names relative to it."""
    starss: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of STARSS23, with mic_dev or foa_dev, video_dev and metadata_dev in it."""
    format: Literal["mic", "foa"] = "mic"
    """Which of STARSS23's audio: the microphones or first-order ambisonics."""
    split: Literal["dev-train", "dev-test"] = "dev-train"
    """Which part of STARSS23."""
    alignment: Annotated[AlignmentOptions, tyro.conf.arg(name="")] = field(default_factory=AlignmentOptions)
    clip_seconds: float = 1.0
    """Length of a clip."""
    hop: float | None = None
    """Seconds from clip to clip; by default the length of a clip, so that none overlap."""
    top: int = 5000
    """Keep this many clips, the loudest of all recordings; 0 keeps all."""
    validation: Literal["none", "recording", "time"] = "none"
    """Keep clips aside: whole recordings, or the end of each."""
    validation_share: float = 0.1
    """How much is kept aside."""
    seed: int = 0
    """Which recordings are kept aside."""
    shard_size: int = 100
    """Clips per tar file."""
    workers: int = 1
    """Processes that cut clips; each decodes video with several threads already."""


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError, OSError: told in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    prepare_with(parse_options(PrepareOptions, args))


def prepare_with(options: PrepareOptions) -> Prepared:
    """Prepares as the options say, and prints what was left out and what was made."""
    from avssl_pyro.recordings.discovery import unique_names
    from avssl_pyro.recordings.preparation import CuttingConfig, prepare

    if options.workers < 1 or options.seed < 0 or options.top < 0:
        raise InputError("--workers must be at least 1, --seed and --top at least 0.")
    array = _array(options)
    hop_s = options.clip_seconds if options.hop is None else options.hop
    cutting = CuttingConfig(options.clip_seconds, hop_s, options.top or None)
    splitter = _splitter(options)
    recordings, labels = _starss(options) if options.starss is not None else (_recordings(options, array), None)
    made = prepare(
        options.out,
        unique_names(recordings),
        array,
        cutting,
        splitter,
        labels,
        scenes_per_shard=options.shard_size,
        workers=options.workers,
    )
    for remark in made.remarks:
        _warn(remark)
    for folder, manifest in made.manifests.items():
        size_mb = sum(shard.num_bytes for shard in manifest.shards) / 1e6
        print(f"{folder}: {manifest.spec.num_scenes} clips in {len(manifest.shards)} shards, {size_mb:.1f} MB.")
    return made


def _array(options: PrepareOptions) -> MicrophoneArray:
    from avssl_pyro.acoustics.presets import resolve_array

    if options.array is not None:
        return resolve_array(options.array)
    if options.starss is None:
        raise InputError("give --array: a preset or a YAML file that says where the microphones are.")
    return resolve_array(f"starss23-{options.format}")


def _splitter(options: PrepareOptions) -> Splitter:
    from avssl_pyro.recordings.split import ByRecording, ByTime, NoSplit

    match options.validation:
        case "recording":
            return ByRecording(options.validation_share, options.seed)
        case "time":
            return ByTime(options.validation_share)
        case _:
            return NoSplit()


def _recordings(options: PrepareOptions, array: MicrophoneArray) -> list[Recording]:
    from avssl_pyro.recordings.discovery import RecordingFiles, read_recording_list, recordings_in_folder

    alignment = options.alignment.of(array)
    sources = (options.folder, options.manifest, options.video or options.audio)
    if sum(source is not None for source in sources) != 1:
        raise InputError("give one of --video with --audio, --folder, --manifest or --starss.")
    files: tuple[RecordingFiles, ...]
    if options.folder is not None:
        files, alone = recordings_in_folder(options.folder, alignment)
        for path in alone:
            _warn(f"{path}: has no partner of the same name; it is left out.")
    elif options.manifest is not None:
        files = read_recording_list(options.manifest, alignment)
    elif options.video is None or options.audio is None:
        raise InputError("give both --video and --audio.")
    else:
        files = (RecordingFiles(options.video, options.audio, alignment),)
    return [entry.open() for entry in files]


def _starss(options: PrepareOptions) -> tuple[list[Recording], tuple[tuple[DcaseRow, ...] | None, ...]]:
    from avssl_pyro.recordings.starss23 import list_starss

    assert options.starss is not None
    if any(source is not None for source in (options.folder, options.manifest, options.video, options.audio)):
        raise InputError("give one of --video with --audio, --folder, --manifest or --starss.")
    files = list_starss(options.starss, options.format, options.split)
    seen = [entry for entry in files if entry.video is not None]
    if len(seen) < len(files):
        _warn(
            f"{options.starss}: {len(files) - len(seen)} of {len(files)} recordings have no video; they are left out."
        )
    if not seen:
        raise InputError(f"{options.starss}: no recording of {options.split} has a video; expected them in video_dev.")
    labels = tuple(None if entry.labels is None else entry.read_labels() for entry in seen)
    return [entry.open() for entry in seen], labels


def _warn(sentence: str) -> None:
    print(f"warning: {sentence}", file=sys.stderr)

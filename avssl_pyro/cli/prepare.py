"""Cuts recordings into clips for training: ``avssl prepare``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from avssl_pyro.cli.options import DEFAULT_SEED, DEFAULT_WORKERS, AlignmentOptions, Seed, Workers, parse_options
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
    """Cut the loudest clips of recordings into shards for 'avssl train --data'.

    Each clip has an image. Give one recording (--video and --audio), a --folder of them, a --manifest, or a copy of
    STARSS23 (--starss). Any length, rate and number of channels will do. After an interruption, the same command
    continues where it stopped.
    """

    out: Path
    """Folder of the shards; with --validation, its sub-folders train and validation."""
    array: str | None = None
    """Array of the recordings: a preset or a YAML file; with --starss by default starss23-mic or starss23-foa."""
    video: Path | None = None
    """360-degree video of one recording, equirectangular, any frame rate."""
    audio: Path | None = None
    """Audio of one recording: WAV or FLAC, any rate."""
    folder: Path | None = None
    """Folder of recordings, each a video and an audio file of the same name."""
    manifest: Annotated[Path | None, tyro.conf.arg(metavar="FILE.csv")] = None
    """CSV file with the columns video and audio, optionally offset_s and yaw_deg; file names are relative to it."""
    starss: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of STARSS23 that contains mic_dev or foa_dev, video_dev and metadata_dev."""
    format: Literal["mic", "foa"] = "mic"
    """Audio format of STARSS23: microphones (mic) or first-order ambisonics (foa)."""
    split: Literal["dev-train", "dev-test"] = "dev-train"
    """Development split of STARSS23."""
    alignment: Annotated[AlignmentOptions, tyro.conf.arg(name="")] = field(default_factory=AlignmentOptions)
    clip_seconds: float = 1.0
    """Length of a clip in seconds."""
    hop: float | None = None
    """Seconds between the starts of clips; by default --clip-seconds, so that clips do not overlap."""
    top: int = 5000
    """Number of clips to keep, the loudest of all recordings; 0 keeps all."""
    validation: Literal["none", "recording", "time"] = "none"
    """Clips kept aside: none, those of whole recordings, or (time) those at the end of each recording."""
    validation_share: float = 0.1
    """Share of the recordings, or of the time of each, that is kept aside."""
    seed: Seed = DEFAULT_SEED
    shard_size: int = 100
    """Clips per tar file."""
    workers: Workers = DEFAULT_WORKERS


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError, OSError: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    prepare_with(parse_options(PrepareOptions, args))


def prepare_with(options: PrepareOptions) -> Prepared:
    """Prepares the clips, prints warnings and the shards, and returns the result."""
    from avssl_pyro.recordings.discovery import unique_names
    from avssl_pyro.recordings.preparation import CuttingConfig, prepare

    if options.top < 0:
        raise InputError(f"--top is {options.top}; give a number of clips, or 0 for all.")
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
        workers=options.workers or -1,
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

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

if TYPE_CHECKING:
    from avssl_pyro.acoustics.array import MicrophoneArray
    from avssl_pyro.recordings.collection import Collection
    from avssl_pyro.recordings.preparation import Prepared
    from avssl_pyro.recordings.split import Splitter


@dataclass(frozen=True)
class PrepareOptions:
    """Cut the loudest clips of recordings into shards for 'avssl train --data'.

    Each clip has an image. Give one recording (--video and --audio) or several (--recordings). Any length, rate and
    number of channels will do. After an interruption, the same command continues where it stopped.
    """

    out: Path = Path("runs/clips")
    """Folder of the shards; with --validation, its sub-folders train and validation."""
    array: str | None = None
    """Array of the recordings: a preset or a YAML file; by default starss23-mic or starss23-foa for STARSS23."""
    video: Path | None = None
    """360-degree video of one recording, equirectangular, any frame rate."""
    audio: Path | None = None
    """Audio of one recording: WAV or FLAC, any rate."""
    recordings: Path | None = None
    """Several recordings: a folder of videos and audio files of the same names; or a CSV file with the columns video
    and audio, optionally offset_s and yaw_deg, and file names relative to it; or the folder of STARSS23 that contains
    mic_dev or foa_dev, video_dev and metadata_dev."""
    format: Literal["mic", "foa"] = "mic"
    """Audio format of STARSS23: microphones (mic) or first-order ambisonics (foa)."""
    split: Literal["dev-train", "dev-test"] = "dev-train"
    """Development split of STARSS23."""
    alignment: Annotated[AlignmentOptions, tyro.conf.arg(name="")] = field(default_factory=AlignmentOptions)
    clip_seconds: float = 1.0
    """Length of a clip in seconds."""
    hop: float | None = None
    """Seconds between the starts of clips; by default --clip-seconds, so that clips do not overlap."""
    num_clips: int = 5000
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
    from avssl_pyro.recordings.preparation import CuttingConfig, prepare

    if options.num_clips < 0:
        raise InputError(f"--num-clips is {options.num_clips}; give a number of clips, or 0 for all.")
    if (options.recordings is None) == (options.video is None and options.audio is None):
        raise InputError("give one recording, --video with --audio, or several, --recordings.")
    array = _array(options)
    hop_s = options.clip_seconds if options.hop is None else options.hop
    cutting = CuttingConfig(options.clip_seconds, hop_s, options.num_clips or None)
    splitter = _splitter(options)
    collection = _open(options, array)
    for remark in collection.remarks:
        _warn(remark)
    made = prepare(
        options.out,
        collection.recordings,
        array,
        cutting,
        splitter,
        collection.labels,
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
    from avssl_pyro.recordings.collection import CollectionKind, collection_kind

    kind = None if options.recordings is None else collection_kind(options.recordings)
    if options.array is not None:
        return resolve_array(options.array)
    if kind is not CollectionKind.STARSS23:
        raise InputError("give --array: a preset, or a YAML file with the positions of the microphones.")
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


def _open(options: PrepareOptions, array: MicrophoneArray) -> Collection:
    from avssl_pyro.recordings.collection import Collection, open_collection
    from avssl_pyro.recordings.recording import Recording

    alignment = options.alignment.of(array)
    if options.recordings is not None:
        return open_collection(options.recordings, alignment, options.format, options.split)
    if options.video is None or options.audio is None:
        raise InputError("give both --video and --audio.")
    return Collection((Recording.open(options.audio, options.video, alignment),))


def _warn(sentence: str) -> None:
    print(f"warning: {sentence}", file=sys.stderr)

"""Localizes the sounding objects of clips, or of a whole recording, with a trained system."""

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from tqdm import tqdm

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.cli.localize_recording import RecordingOptions, localize_recording
from avssl_pyro.cli.options import choose_system, given, parse_options
from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.io.clip_files import read_clip
from avssl_pyro.io.csv_table import read_csv_table
from avssl_pyro.io.separated_sound import write_separated
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.localization.posterior import ONE_PASS_THRESHOLDS, REFINED_THRESHOLDS, SourceThresholds
from avssl_pyro.separation.separator import Separator
from avssl_pyro.viz.overlay import save_overlay


@dataclass(frozen=True)
class LocalizeOptions:
    """Tell which objects in a 360-degree image are sounding, where, how much, and how sure that is."""

    out: Path
    """Result: JSON for one clip, JSON lines for a manifest or a recording."""
    checkpoint: Path | None = None
    """Checkpoint of svi_train.py (.safetensors); by default the weights that come with the package."""
    image: Path | None = None
    """Equirectangular image, twice as wide as high, or 88 x 288."""
    audio: Path | None = None
    """WAV or FLAC of any rate, one channel per microphone."""
    manifest: Annotated[Path | None, tyro.conf.arg(metavar="CLIPS.csv")] = None
    """Instead of --image and --audio: a CSV file with columns audio and image; paths are relative to it."""
    array: str | None = None
    """Preset or YAML file of the array that recorded. A checkpoint knows its own; give it to have that checked, or
    because this recording has the microphones on other channels."""
    overlay: Path | None = None
    """Picture to write; a folder in case of a manifest."""
    separate: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder for the sound of each source: one 16 kHz WAV per source, named after the clip and the azimuth."""
    rounds: int = RefinementConfig().rounds
    """Most rounds of refinement, closed-form ascent that fits the posterior to a clip; 0 is the networks' answer,
    faster and much less accurate."""
    thresholds: SourceThresholds = REFINED_THRESHOLDS
    """When a source class counts as a source; the defaults are higher with --rounds 0."""
    device: str = "cpu"
    """Torch device."""
    recording: Annotated[RecordingOptions, tyro.conf.arg(name="")] = field(default_factory=RecordingOptions)
    """A whole recording."""


@dataclass(frozen=True)
class _Input:
    image: Path
    audio: Path


def parse(args: Sequence[str] | None = None) -> LocalizeOptions:
    """Options of the command line; the default thresholds are those of refined posteriors or of one forward pass."""
    thresholds = ONE_PASS_THRESHOLDS if given("--rounds", args) == "0" else REFINED_THRESHOLDS
    return parse_options(LocalizeOptions, args, default=LocalizeOptions(tyro.MISSING, thresholds=thresholds))


def main(args: Sequence[str] | None = None) -> int | None:
    """Runs the command with ``args`` (by default those of the process).

    Returns:
        The exit code, None for success.

    Raises:
        InputError, OSError: told in one sentence by :func:`avssl_pyro.cli.command.run`; no output is written then.
    """
    options = parse(args)
    whole = options.recording.video is not None
    inputs = [] if whole else _inputs(options)
    system, array = choose_system(options.checkpoint, options.array)
    if options.overlay is not None and options.manifest is None and options.overlay.suffix.lower() != ".png":
        raise InputError(f"--overlay {options.overlay}: pictures are written as PNG; give a name that ends in .png.")
    if options.separate is not None and options.separate.exists() and not options.separate.is_dir():
        raise InputError(f"--separate {options.separate}: is a file; name a folder.")
    if options.rounds < 0:
        raise InputError(f"--rounds is {options.rounds}; give a number of rounds of refinement, or 0 for none.")
    refinement = RefinementConfig(rounds=options.rounds) if options.rounds else None
    localizer = Localizer(system, options.device, refinement=refinement, thresholds=options.thresholds)
    if whole:
        audio = _audio_of_recording(options)
        refined = options.rounds > 0
        return localize_recording(options.recording, audio, options.out, array, localizer, refined)
    # Everything is read once before anything is written, so that a bad clip late in a manifest leaves nothing behind.
    for entry in inputs:
        if not read_clip(entry.image, entry.audio, array).audio_mn.any():
            print(f"warning: {entry.audio}: is silent throughout.", file=sys.stderr)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    lines = list(_results(inputs, options, array, localizer))
    write_atomically(options.out, "".join(f"{line}\n" for line in lines).encode())
    if options.manifest is None:
        _print_sources(json.loads(lines[0]))
    return None


def _audio_of_recording(options: LocalizeOptions) -> Path:
    for name in ("image", "manifest", "overlay", "separate"):
        if getattr(options, name) is not None:
            raise InputError(f"--{name} is for single clips; leave it out, or leave out --video.")
    if options.audio is None:
        raise InputError("give --audio with --video: the array's recording, one channel per microphone.")
    return options.audio


def _inputs(options: LocalizeOptions) -> list[_Input]:
    options.recording.check_unused()
    if options.manifest is not None:
        if options.image is not None or options.audio is not None:
            raise InputError("give either --manifest or --image with --audio, not both.")
        return read_manifest(options.manifest)
    if options.image is None or options.audio is None:
        raise InputError(
            "give --image and --audio, or --manifest with many of them, or --video and --audio for a whole recording."
        )
    return [_Input(options.image, options.audio)]


def read_manifest(path: Path) -> list[_Input]:
    """Reads a CSV file with columns ``audio`` and ``image``.

    Raises:
        InputError: the file is missing, lacks a column, has an empty cell or no row.
    """
    lines = read_csv_table(path, ("audio", "image")).lines
    return [_Input(path.parent / line.file_name("image"), path.parent / line.file_name("audio")) for line in lines]


def _results(
    inputs: Sequence[_Input],
    options: LocalizeOptions,
    array: MicrophoneArray,
    localizer: Localizer,
) -> Iterator[str]:
    separator = None if options.separate is None else Separator(localizer.config)
    for number, entry in enumerate(tqdm(inputs, unit="clip", desc="localizing", disable=len(inputs) == 1)):
        clip = read_clip(entry.image, entry.audio, array)
        (found,) = localizer.localize([clip])
        posterior, sources = found.posterior, found.sources
        if options.overlay is not None:
            save_overlay(
                _overlay_path(options, number, clip), clip.image_ijc, posterior, sources, localizer.config.grid
            )
        separated = None
        if separator is not None and options.separate is not None:
            sound_sn = separator.separate(clip.audio_mn, posterior, sources)
            azimuths = [source.azimuth for source in sources]
            separated = write_separated(options.separate, _name(options, number, clip), azimuths, sound_sn)
        result = found.to_dict(
            separated,
            audio=str(entry.audio),
            image=str(entry.image),
            array=array.to_dict(),
            checkpoint="shipped" if options.checkpoint is None else str(options.checkpoint),
        )
        yield json.dumps(result, allow_nan=False)


def _overlay_path(options: LocalizeOptions, number: int, clip: Clip) -> Path:
    assert options.overlay is not None
    return options.overlay if options.manifest is None else options.overlay / f"{_name(options, number, clip)}.png"


def _name(options: LocalizeOptions, number: int, clip: Clip) -> str:
    """What a clip's own files are called; those of a manifest may share names, and have numbers."""
    return clip.key if options.manifest is None else f"{number:05d}-{clip.key}"


def _print_sources(result: dict[str, list[dict[str, float]]]) -> None:
    if not result["sources"]:
        print("no sounding object found.")
    for source in result["sources"]:
        print(
            f"azimuth {source['azimuth_deg']:+7.1f} +- {source['azimuth_std_deg']:.1f} deg   "
            f"level {source['level']:.2f} +- {source['level_std']:.2f}"
        )

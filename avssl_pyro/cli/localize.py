"""Estimates the sources of clips, or of a whole recording, with a trained system."""

import contextlib
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.cli.localize_recording import RecordingOptions, localize_recording, warn_of_gains
from avssl_pyro.cli.options import DEFAULT_DEVICE, Device, choose_system, parse_options
from avssl_pyro.cli.outputs import check_outputs
from avssl_pyro.errors import InputError
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.io.csv_table import read_csv_table
from avssl_pyro.localization.direct_level import DirectLevelRule

if TYPE_CHECKING:
    from avssl_pyro.api.model import Model
    from avssl_pyro.api.result import Result

STANDARD_OUTPUT = Path("-")


@dataclass(frozen=True)
class LocalizeOptions:
    """Estimate which objects in a 360-degree image are sounding, where, how much, and how sure that is.

    Without an image the sources are estimated from the audio alone.
    """

    audio: Path | None = None
    """WAV or FLAC of any rate, one channel per microphone."""
    image: Path | None = None
    """Equirectangular image, twice as wide as high, or 88 x 288."""
    clips: Annotated[Path | None, tyro.conf.arg(metavar="CLIPS.csv")] = None
    """Instead of --audio and --image: a CSV file with the column audio and, where there are pictures, image; paths are
    relative to it. One line of JSON per clip is written as soon as the clip is done."""
    out: Path = STANDARD_OUTPUT
    """Result: JSON for one clip, JSON lines for many or for a recording; '-' is standard output."""
    array: str | None = None
    """Preset or YAML file of the array that recorded. A checkpoint has its own, which is compared with this one; a
    recording with the microphones on other channels needs both."""
    checkpoint: Path | None = None
    """Checkpoint of a training (.safetensors); by default the pretrained weights of the package."""
    overlay: Path | None = None
    """Picture to write; a folder in case of --clips."""
    separate: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder for the sound of each source: one 16 kHz WAV per source, named after the clip and the azimuth."""
    rounds: int = RefinementConfig().rounds
    """Most rounds of refinement, closed-form ascent that fits the posterior to a clip; 0 is the networks' answer,
    faster and much less accurate."""
    least_level: float | None = None
    """Least level of the direct sound of a source, 0 to 1; higher values report fewer sources. By default 0.007, or
    0.035 with --rounds 0."""
    device: Device = DEFAULT_DEVICE
    recording: Annotated[RecordingOptions, tyro.conf.arg(name="")] = field(default_factory=RecordingOptions)
    """A whole recording."""


@dataclass(frozen=True)
class _ClipFiles:
    """Audio and image of one clip, as they were named and as they are found."""

    audio_name: str
    audio: Path
    image: Path | None


def parse(args: Sequence[str] | None = None) -> LocalizeOptions:
    """Options of the command line."""
    return parse_options(LocalizeOptions, args)


def main(args: Sequence[str] | None = None) -> int | None:
    """Runs the command with ``args`` (by default those of the process).

    Returns:
        The exit code, None for success.

    Raises:
        InputError, OSError: reported in one sentence by :func:`avssl_pyro.cli.command.run`; bad input is found before
            anything is written.
    """
    options = parse(args)
    if options.rounds < 0:
        raise InputError(f"--rounds is {options.rounds}; give a number of rounds of refinement, or 0 for none.")
    if options.least_level is not None and not 0 <= options.least_level <= 1:
        raise InputError(f"--least-level is {options.least_level:g}; give a direct level from 0 to 1.")
    if options.overlay is not None and options.clips is None and options.overlay.suffix.lower() != ".png":
        raise InputError(f"--overlay {options.overlay}: pictures are written as PNG; give a name that ends in .png.")
    if options.separate is not None and options.separate.exists() and not options.separate.is_dir():
        raise InputError(f"--separate {options.separate}: is a file; name a folder.")
    audio = _audio_of_recording(options)
    inputs = _inputs(options) if audio is None else []
    model = _model(options)
    out = None if options.out == STANDARD_OUTPUT else options.out
    if audio is not None:
        return localize_recording(options.recording, audio, out, model.array, model.localizer, options.rounds > 0)
    _check_inputs(inputs, options.clips or inputs[0].audio, model)
    overlay = options.overlay if options.clips is None else None
    check_outputs((out, overlay), (options.clips, *_files(inputs)))
    if options.clips is not None:
        _localize_many(inputs, options, model, out)
        return None
    result, line = _localize_one(inputs[0], options, model, inputs[0].audio.stem)
    if out is None:
        print(json.dumps(line, allow_nan=False))
    else:
        write_atomically(out, (json.dumps(line, allow_nan=False) + "\n").encode())
    _print_sources(result, sys.stdout if out is not None else sys.stderr)
    return None


def _model(options: LocalizeOptions) -> "Model":
    from avssl_pyro.api.model import PRETRAINED_NAME, Model

    system, array = choose_system(options.checkpoint, options.array)
    weights = PRETRAINED_NAME if options.checkpoint is None else str(options.checkpoint)
    refinement = RefinementConfig(rounds=options.rounds) if options.rounds else None
    rule = None if options.least_level is None else DirectLevelRule(least=options.least_level)
    return Model(system, array, weights, options.device, refinement, rule)


def _audio_of_recording(options: LocalizeOptions) -> Path | None:
    """The audio file of a whole recording; None for clips."""
    if options.recording.video is None:
        options.recording.check_unused()
        return None
    for name in ("image", "clips", "overlay", "separate"):
        if getattr(options, name) is not None:
            raise InputError(f"--{name} is for single clips; leave it out, or leave out --video.")
    if options.audio is None:
        raise InputError("give --audio with --video: the array's recording, one channel per microphone.")
    return options.audio


def _inputs(options: LocalizeOptions) -> list[_ClipFiles]:
    if options.clips is not None:
        if options.image is not None or options.audio is not None:
            raise InputError("give either --clips or --audio with --image, not both.")
        return read_clip_list(options.clips)
    if options.audio is None:
        raise InputError(
            "give --audio, and --image if there is one; or --clips with many of them, or --video and --audio for a "
            "whole recording."
        )
    return [_ClipFiles(str(options.audio), options.audio, options.image)]


def read_clip_list(path: Path) -> list[_ClipFiles]:
    """Reads a CSV file with the column ``audio`` and perhaps ``image``, whose cells may be empty.

    Raises:
        InputError: the file is missing, lacks the column, has an empty cell in it or no row.
    """
    clips = []
    for line in read_csv_table(path, ("audio",)).lines:
        name, image = line.file_name("audio"), line.cells.get("image")
        clips.append(_ClipFiles(name, path.parent / name, path.parent / image if image else None))
    return clips


def _files(inputs: Sequence[_ClipFiles]) -> Iterator[Path]:
    for entry in inputs:
        yield entry.audio
        if entry.image is not None:
            yield entry.image


def _check_inputs(inputs: Sequence[_ClipFiles], source: Path, model: "Model") -> None:
    """Reads everything once before anything is written, so that a bad clip late in a list leaves nothing behind.

    Gains of the channels are compared over all clips, and ``source`` is named with those that differ.
    """
    from avssl_pyro.acoustics.channel_gains import ChannelGains
    from avssl_pyro.clip import is_silent
    from avssl_pyro.io.audio import read_audio
    from avssl_pyro.io.images import read_image

    gains = []
    for entry in inputs:
        audio_mn = read_audio(entry.audio, model.array)
        if is_silent(audio_mn):
            print(f"warning: {entry.audio}: is silent throughout.", file=sys.stderr)
        else:
            gains.append(model.localizer.gains_of(audio_mn[None]))
        if entry.image is not None:
            read_image(entry.image)
        else:
            # Refuses a model without refinement, by name.
            assert model.audio_only_localizer
    if gains:
        warn_of_gains(ChannelGains.median(gains), source, model.array)


def _localize_many(inputs: Sequence[_ClipFiles], options: LocalizeOptions, model: "Model", out: Path | None) -> None:
    from tqdm import tqdm

    with _writer(out) as write:
        for number, entry in enumerate(tqdm(inputs, unit="clip", desc="localizing")):
            # Clips may share their files' names.
            _, line = _localize_one(entry, options, model, f"{number:05d}-{entry.audio.stem}")
            write(line)


def _localize_one(
    entry: _ClipFiles, options: LocalizeOptions, model: "Model", name: str
) -> "tuple[Result, dict[str, Any]]":
    """Localizes one clip, writes its picture and its sounds, and returns its result, whole and as JSON values."""
    result = model.localize(entry.audio, entry.image)
    if options.overlay is not None:
        result.plot(options.overlay if options.clips is None else options.overlay / f"{name}.png")
    separated = None if options.separate is None else result.save_sounds(options.separate, name)
    return result, result.to_dict(separated) | {"audio": entry.audio_name}


@contextlib.contextmanager
def _writer(out: Path | None) -> Iterator[Callable[[dict[str, Any]], None]]:
    """A function that writes one line of JSON to a file or to standard output, at once."""
    with contextlib.ExitStack() as stack:
        stream = sys.stdout if out is None else stack.enter_context(out.open("w", encoding="utf-8"))

        def write(values: dict[str, Any]) -> None:
            stream.write(json.dumps(values, allow_nan=False) + "\n")
            stream.flush()

        yield write


def _print_sources(result: "Result", stream: Any) -> None:
    if not result.sources:
        print("no sounding object found.", file=stream)
    for source in result.sources:
        print(
            f"azimuth {source.azimuth_deg:+7.1f} +- {source.azimuth_std_deg:.1f} deg   "
            f"level {source.level:.2f} +- {source.level_std:.2f}",
            file=stream,
        )

"""Checks recordings or shards against their array and camera: ``avssl doctor``."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from avssl_pyro.cli.options import AlignmentOptions, parse_options
from avssl_pyro.errors import InputError

if TYPE_CHECKING:
    from avssl_pyro.acoustics.array import MicrophoneArray
    from avssl_pyro.clip import Clip
    from avssl_pyro.diagnosis.finding import Finding
    from avssl_pyro.systems.system import System

EXIT_FINDINGS = 1
FORMAT = "avssl-diagnosis/1"


@dataclass(frozen=True)
class DoctorOptions:
    """Check a recording or shards against the array and the camera.

    The check of the camera needs --checkpoint or --camera. The exit code is 1 if a finding is worse than a note,
    otherwise 0.
    """

    audio: Path | None = None
    """WAV or FLAC of any rate and length, one channel per microphone."""
    video: Path | None = None
    """360-degree video of the recording, equirectangular."""
    image: Path | None = None
    """Instead of --video: one equirectangular image for the whole recording."""
    data: Path | None = None
    """Instead of --audio: folder of shards made by 'avssl simulate' or 'avssl prepare'."""
    array: str | None = None
    """Preset or YAML file of the array; by default that of --data, or with --audio that of --checkpoint."""
    checkpoint: Path | None = None
    """Checkpoint of 'avssl train', to estimate the yaw of the camera and whether its picture is mirrored."""
    camera: bool = False
    """Estimate yaw and mirroring with the pretrained weights if no --checkpoint is given."""
    alignment: Annotated[AlignmentOptions, tyro.conf.arg(name="")] = field(default_factory=AlignmentOptions)
    """Position of picture and sound relative to each other, as far as known."""
    json: bool = False
    """Print JSON instead of one line per finding."""


def main(args: Sequence[str] | None = None) -> int:
    """Runs the command with ``args`` (by default those of the process).

    Returns:
        0 if there is no finding worse than a note, otherwise 1.

    Raises:
        InputError, OSError: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    from avssl_pyro.diagnosis.finding import Severity
    from avssl_pyro.systems.checkpoint import load_checkpoint

    options = parse_options(DoctorOptions, args)
    system = None if options.checkpoint is None else load_checkpoint(options.checkpoint)
    if options.data is not None:
        if options.audio or options.video or options.image:
            raise InputError("give either --data or files, not both.")
        findings = _examine_shards(options.data, options, system)
    elif options.audio is not None:
        findings = _examine_files(options.audio, options, system)
    else:
        raise InputError("give --audio FILE or --data FOLDER.")
    print(_json(options, findings) if options.json else "\n".join(map(_line, findings)))
    return EXIT_FINDINGS if any(finding.severity >= Severity.WARNING for finding in findings) else 0


def _examine_shards(folder: Path, options: DoctorOptions, system: System | None) -> tuple[Finding, ...]:
    from avssl_pyro.acoustics.presets import resolve_array
    from avssl_pyro.datasets.dataset import SceneDataset
    from avssl_pyro.diagnosis.examination import examine
    from avssl_pyro.recordings.excerpts import MOST_EXCERPTS, Excerpts, evenly

    wanted = None if options.array is None else resolve_array(options.array)
    dataset = SceneDataset(folder, wanted)
    clips = [dataset[index] for index in evenly(len(dataset), MOST_EXCERPTS)]
    findings = examine(Excerpts.of_clips(clips), dataset.array)
    return (*findings, *_camera(options, system, dataset.array, clips))


def _examine_files(audio: Path, options: DoctorOptions, system: System | None) -> tuple[Finding, ...]:
    from avssl_pyro.diagnosis.examination import examine
    from avssl_pyro.diagnosis.recording_samples import check_recording_lag, spread_clips
    from avssl_pyro.diagnosis.synchronization import check_durations
    from avssl_pyro.io.images import read_image
    from avssl_pyro.recordings.excerpts import read_excerpts
    from avssl_pyro.recordings.recording import Recording

    if options.video is not None and options.image is not None:
        raise InputError("give either --video or --image, not both.")
    with_camera = system is not None or options.camera
    if with_camera and options.video is None and options.image is None:
        raise InputError("to find out how the camera is turned, give --video or --image as well.")
    array = _array(options, system)
    recording = Recording.open(audio, options.video, options.alignment.of(array)).with_channels_of(array)
    recording.check_picture()
    still_ijc = None if options.image is None else recording.fit(read_image(options.image))
    findings = examine(read_excerpts(audio).select(array.channel_indices), array)
    if recording.video is not None:
        audio_file, video = recording.audio, recording.video
        findings += check_durations(audio_file.duration_s, audio_file.sample_rate, video.duration_s)
        findings += check_recording_lag(recording, video, progress=True)
    if with_camera:
        findings += _camera(options, system, array, spread_clips(recording, still_ijc))
    return findings


def _array(options: DoctorOptions, system: System | None) -> MicrophoneArray:
    from avssl_pyro.acoustics.presets import resolve_array

    if options.array is not None:
        return resolve_array(options.array)
    if system is None:
        raise InputError("give --array, a preset or YAML file, or --checkpoint, whose array is the default.")
    return system.config.array


def _camera(
    options: DoctorOptions, system: System | None, array: MicrophoneArray, clips: Sequence[Clip]
) -> tuple[Finding, ...]:
    from avssl_pyro.acoustics.compatibility import check_trained_array
    from avssl_pyro.diagnosis.camera import AS_IT_IS, check_camera
    from avssl_pyro.diagnosis.orientation import Turn
    from avssl_pyro.systems.pretrained import load_pretrained

    if system is not None:
        check_trained_array(system.config.array, array, str(options.checkpoint))
    elif options.camera:
        pretrained = load_pretrained(array)
        print(pretrained.sentence, file=sys.stderr)
        system = pretrained.system
    else:
        return ()
    given = Turn(options.alignment.mirror, options.alignment.yaw) if options.data is None else AS_IT_IS
    return check_camera(system, clips, given, progress=True)


def _line(finding: Finding) -> str:
    advice = f" -> {finding.advice}" if finding.advice else ""
    return f"{finding.severity.word:8}{finding.check}: {finding.message} (sure: {finding.confidence:.0%}){advice}"


def _json(options: DoctorOptions, findings: Sequence[Finding]) -> str:
    source = options.data if options.audio is None else options.audio
    content = {"format": FORMAT, "source": str(source), "findings": [finding.to_dict() for finding in findings]}
    return json.dumps(content, indent=1, allow_nan=False)

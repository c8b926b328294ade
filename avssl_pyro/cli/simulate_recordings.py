"""Renders recordings in STARSS23's format: ``avssl simulate-recordings``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from avssl_pyro.cli.options import DEFAULT_SEED, AssetOptions, Seed, parse_options
from avssl_pyro.errors import InputError

if TYPE_CHECKING:
    from avssl_pyro.simulation.recordings import RecordingSimulator


@dataclass(frozen=True)
class SimulateRecordingsOptions:
    """Render labelled 360-degree recordings of people in a room.

    The people walk, stand, talk and pause. Writes mic_dev (or foa_dev), video_dev and metadata_dev as in STARSS23, for
    'avssl prepare --recordings'. Synthetic material replaces --speech, --people or --panoramas where they are not
    given. The number of the room in file names is the --seed.
    """

    out: Path = Path("runs/recordings")
    """Folder of the recordings; it may hold recordings of other seeds."""
    seconds: float = 60.0
    """Length of a recording in seconds, from 1 to 3600."""
    num_recordings: int = 1
    """Number of recordings, from 1 to 999."""
    array: str = "starss23-mic"
    """Array to render: a preset or a YAML file (docs/arrays.md), without measured responses."""
    seed: Seed = DEFAULT_SEED
    split: Literal["dev-train", "dev-test"] = "dev-test"
    """STARSS23 split of the recordings."""
    material: Annotated[AssetOptions, tyro.conf.arg(name="")] = field(default_factory=AssetOptions)
    width: int = 1920
    """Width of the video in pixels, at least 288 and a multiple of four; the height is half of it."""
    frame_rate: float = 30_000 / 1001
    """Frame rate of the video in hertz, from 1 to 120."""
    sample_rate: int = 24_000
    """Sample rate of the audio in hertz, from 8000 to 192000; speech extends up to 8 kHz."""
    yaw: float = 0.0
    """Azimuth of the picture's centre column in degrees, counter-clockwise from the array's x axis."""
    mirror: bool = False
    """Mirror the picture, so that left and right are exchanged."""


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process).

    Raises:
        InputError, OSError: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    options = parse_options(SimulateRecordingsOptions, args)
    _check(options)
    from avssl_pyro.recordings.starss23_writer import StarssWriter

    simulator = _simulator(options)
    for source in (simulator.speech, simulator.people, simulator.panoramas):
        print(f"from {source.describe()}")
    writer = StarssWriter(options.out, options.split, options.sample_rate, options.frame_rate)
    for index in range(options.num_recordings):
        recording = simulator.draw(index)
        files = writer.write(recording, index, progress=True)
        print(f"{files.audio}: {recording.num_people} people, {recording.num_talkers} of them talk.")


def _check(options: SimulateRecordingsOptions) -> None:
    import numpy as np

    if options.num_recordings < 1 or options.num_recordings > 999:
        raise InputError(f"--num-recordings is {options.num_recordings}; give a number from 1 to 999.")
    if not 1.0 <= options.seconds <= 3600.0:
        raise InputError(f"--seconds is {options.seconds:g}; give a length from 1 to 3600.")
    if options.width < 288 or options.width % 4:
        raise InputError(f"--width is {options.width}; give a multiple of four of at least 288.")
    if not 1.0 <= options.frame_rate <= 120.0:
        raise InputError(f"--frame-rate is {options.frame_rate:g}; give one from 1 to 120.")
    if not 8_000 <= options.sample_rate <= 192_000:
        raise InputError(f"--sample-rate is {options.sample_rate}; give hertz, from 8000 to 192000.")
    if not np.isfinite(options.yaw):
        raise InputError(f"--yaw is {options.yaw}; give degrees.")


def _simulator(options: SimulateRecordingsOptions) -> RecordingSimulator:
    import numpy as np

    from avssl_pyro.acoustics.presets import resolve_array
    from avssl_pyro.simulation.motion import MovingPeopleConfig
    from avssl_pyro.simulation.recordings import Camera

    camera = Camera(options.width, float(np.deg2rad(options.yaw)), options.mirror)
    array = resolve_array(options.array)
    return options.material.recording_simulator(MovingPeopleConfig(), options.seconds, options.seed, array, camera)

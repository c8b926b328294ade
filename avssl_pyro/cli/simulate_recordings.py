"""Renders recordings in STARSS23's format: ``avssl simulate-recordings``."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.cli.options import DEFAULT_SEED, AssetOptions, Seed, parse_options
from avssl_pyro.clip import SAMPLE_RATE
from avssl_pyro.errors import InputError
from avssl_pyro.io.dcase import write_dcase

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from avssl_pyro.acoustics.array import MicrophoneArray
    from avssl_pyro.simulation.recordings import RecordingSimulator, SimulatedRecording

FRAME_RATE = 30_000 / 1001
# Folds of these splits in STARSS23, by which its file names begin.
FOLDS = {"dev-train": 3, "dev-test": 4}
SOURCE = "simulated"


@dataclass(frozen=True)
class SimulateRecordingsOptions:
    """Render labelled 360-degree recordings of people in a room.

    The people walk, stand, talk and pause. Writes mic_dev (or foa_dev), video_dev and metadata_dev as in STARSS23, for
    'avssl prepare --recordings'. Synthetic material replaces --speech, --people or --panoramas where they are not
    given. The number of the room in file names is the --seed.
    """

    out: Path
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
    frame_rate: float = FRAME_RATE
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
    simulator = _simulator(options)
    for source in (simulator.speech, simulator.people, simulator.panoramas):
        print(f"from {source.describe()}")
    for index in range(options.num_recordings):
        name = f"fold{FOLDS[options.split]}_room{options.seed}_mix{index + 1:03d}"
        audio, labels, video = _paths(options, simulator.array, name)
        recording = simulator.draw(index)
        _write_audio(audio, recording, options.sample_rate)
        write_dcase(labels, recording.labels)
        _write_video(video, recording, options)
        talking = int(recording.voices.sounding_st.any(axis=1).sum())
        print(f"{audio}: {len(recording.people.distances_s)} people, {talking} of them talk.")


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


def _paths(options: SimulateRecordingsOptions, array: MicrophoneArray, name: str) -> tuple[Path, Path, Path]:
    """Paths of audio, labels and video in STARSS23's layout; makes their folders."""
    from avssl_pyro.acoustics.steering_kinds import AmbisonicsKind

    audio_format = "foa" if isinstance(array.steering, AmbisonicsKind) else "mic"
    split = f"{options.split}-{SOURCE}"
    paths = (
        options.out / f"{audio_format}_dev" / split / f"{name}.wav",
        options.out / "metadata_dev" / split / f"{name}.csv",
        options.out / "video_dev" / split / f"{name}.mp4",
    )
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
    return paths


def _write_audio(path: Path, recording: SimulatedRecording, rate: int) -> None:
    """Writes 16-bit audio on the channels of the array; other channels are silent."""
    import numpy as np
    import soundfile
    from scipy.signal import resample_poly

    array = recording.simulator.array
    audio_mn: npt.NDArray[np.float32] = recording.render_audio()
    if rate != SAMPLE_RATE:
        divisor = int(np.gcd(rate, SAMPLE_RATE))
        audio_mn = resample_poly(audio_mn, rate // divisor, SAMPLE_RATE // divisor, axis=-1)
    channels_cn = np.zeros((max(array.channel_indices) + 1, audio_mn.shape[1]), dtype=np.float32)
    channels_cn[list(array.channel_indices)] = audio_mn
    buffer = io.BytesIO()
    soundfile.write(buffer, channels_cn.T, rate, format="WAV", subtype="PCM_16")
    write_atomically(path, buffer.getvalue())


def _write_video(path: Path, recording: SimulatedRecording, options: SimulateRecordingsOptions) -> None:
    from tqdm import tqdm

    from avssl_pyro.io.video_writer import open_video

    film, rate = recording.render_video(), options.frame_rate
    seconds = recording.voices.sounding_st.shape[1] / 10
    with open_video(path, options.width, options.width // 2, rate) as writer:
        for number in tqdm(range(round(seconds * rate)), unit="frame", desc=path.stem):
            writer.write(film.frame_at(number / rate), number / rate)

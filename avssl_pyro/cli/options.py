"""Options that several commands share; none of them imports torch."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import tyro

from avssl_pyro.errors import InputError

if TYPE_CHECKING:
    from avssl_pyro.acoustics.array import MicrophoneArray
    from avssl_pyro.recordings.recording import Alignment
    from avssl_pyro.simulation.motion import MovingPeopleConfig
    from avssl_pyro.simulation.panoramas import PanoramaSource
    from avssl_pyro.simulation.people import PersonSource
    from avssl_pyro.simulation.recordings import Camera, RecordingSimulator
    from avssl_pyro.simulation.speech import SpeechSource
    from avssl_pyro.systems.system import System

OptionsT = TypeVar("OptionsT")

# One help text and one default for each option of many commands; parse_options checks their ranges.
Seed = Annotated[int, tyro.conf.arg(help="Seed of all random draws, at least 0; the same seed repeats them.")]
DEFAULT_SEED = 0
Workers = Annotated[int | None, tyro.conf.arg(help="Number of processes; by default one per core.")]
DEFAULT_WORKERS = None
Device = Annotated[str, tyro.conf.arg(help="Torch device of the networks, such as cpu or cuda.")]
DEFAULT_DEVICE = "cpu"


@dataclass(frozen=True)
class AlignmentOptions:
    """The position of picture and sound relative to each other."""

    offset: float = 0.0
    """Seconds that the audio began before the video; negative if it began later."""
    yaw: float = 0.0
    """Azimuth of the picture's centre column in degrees, counter-clockwise from the array's x axis."""
    mirror: bool = False
    """The picture shows left and right exchanged."""
    elevations: Annotated[tuple[float, float] | None, tyro.conf.arg(metavar="LOWEST HIGHEST")] = None
    """Elevations of the picture's bottom and top in degrees, if it is no full sphere."""

    def of(self, array: "MicrophoneArray") -> "Alignment":
        """The alignment, with the channels that the array names."""
        from avssl_pyro.recordings.recording import Alignment

        channels = array.channels and array.channel_indices
        return Alignment(self.offset, self.yaw, self.mirror, self.elevations, channels)


@dataclass(frozen=True)
class AssetOptions:
    """Folders of material for simulations; material made in code replaces a missing one."""

    speech: Path | None = None
    """Folder of speech files: WAV or FLAC, any rate."""
    people: Path | None = None
    """Folder of cut-outs of people: RGBA PNG, feet at the bottom."""
    panoramas: Path | None = None
    """Folder of rooms: equirectangular JPEG or PNG, twice as wide as high."""

    def speech_source(self) -> "SpeechSource":
        from avssl_pyro.simulation.speech import SpeechFolder
        from avssl_pyro.simulation.synthetic.speech import ProceduralSpeech

        return ProceduralSpeech() if self.speech is None else SpeechFolder(self.speech)

    def person_source(self) -> "PersonSource":
        from avssl_pyro.simulation.people import PeopleFolder
        from avssl_pyro.simulation.synthetic.people import ProceduralPerson

        return ProceduralPerson() if self.people is None else PeopleFolder(self.people)

    def panorama_source(self) -> "PanoramaSource":
        from avssl_pyro.simulation.panoramas import PanoramaFolder
        from avssl_pyro.simulation.synthetic.rooms import ProceduralRoom

        return ProceduralRoom() if self.panoramas is None else PanoramaFolder(self.panoramas)

    def recording_simulator(
        self, config: "MovingPeopleConfig", seconds: float, seed: int, array: "MicrophoneArray", camera: "Camera"
    ) -> "RecordingSimulator":
        """A simulator of recordings of this material, whole frames of labels long."""
        from avssl_pyro.simulation.recordings import RecordingSimulator

        return RecordingSimulator(
            config=replace(config, walks=replace(config.walks, seconds=round(seconds, 1))),
            seed=seed,
            array=array,
            camera=camera,
            speech=self.speech_source(),
            people=self.person_source(),
            panoramas=self.panorama_source(),
        )


def choose_system(
    checkpoint: Path | None, array: str | None, default_array: str | None = None
) -> "tuple[System, MicrophoneArray]":
    """The system of a checkpoint, or the pretrained one, which is named on standard error.

    Args:
        checkpoint: file of a training.
        array: preset or YAML file of the array to serve; a checkpoint's own array is compared with it.
        default_array: preset of the array where neither is given.

    Returns:
        The system, and the array to serve, which may have its microphones on other channels.

    Raises:
        InputError: a file cannot be read, the checkpoint is of another array, or nothing names an array.
    """
    from avssl_pyro.acoustics.compatibility import check_trained_array
    from avssl_pyro.acoustics.presets import resolve_array
    from avssl_pyro.systems.checkpoint import load_checkpoint
    from avssl_pyro.systems.pretrained import load_pretrained

    served = None if array is None else resolve_array(array)
    if checkpoint is not None:
        system = load_checkpoint(checkpoint)
        if served is None:
            return system, system.config.array
        check_trained_array(system.config.array, served, str(checkpoint))
        return system, served
    if served is None:
        if default_array is None:
            raise InputError(
                "give --array, the microphones that recorded: a preset or a YAML file; or give --checkpoint."
            )
        served = resolve_array(default_array)
    pretrained = load_pretrained(served)
    print(pretrained.sentence, file=sys.stderr)
    return pretrained.system, served


def parse_options(kind: type[OptionsT], args: Sequence[str] | None, default: OptionsT | None = None) -> OptionsT:
    """Options of a command line; help and mistakes end the process, as tyro has it.

    Args:
        kind: dataclass of the options.
        args: the command line; by default that of the process.
        default: options in place of the dataclass's own defaults.

    Raises:
        InputError: the seed or the number of processes is out of range.
    """
    if default is None:
        options = tyro.cli(kind, prog=_program(), args=args)
    else:
        options = tyro.cli(kind, prog=_program(), args=args, default=default)
    seed, workers = getattr(options, "seed", DEFAULT_SEED), getattr(options, "workers", DEFAULT_WORKERS)
    if seed < 0:
        raise InputError(f"--seed is {seed}; give a number of at least 0.")
    if workers is not None and workers < 1:
        raise InputError(f"--workers is {workers}; give a number of at least 1, or leave it out for one per core.")
    return options


def _program() -> str:
    """The words that start this command: ``avssl train``, or the name of a script."""
    name = Path(sys.argv[0]).name
    if name in ("avssl", "avssl.exe", "__main__.py"):
        return " ".join(["avssl", *takewhile(lambda word: not word.startswith("-"), sys.argv[1:])])
    return name


def given(option: str, args: Sequence[str] | None) -> str | None:
    """The text given for an option that decides the defaults of others, or None; the command is parsed afterwards.

    Args:
        option: name of the option, with its dashes.
        args: the command line; by default that of the process.
    """
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument(option, dest="text")
    text: str | None = parser.parse_known_args(args)[0].text
    return text

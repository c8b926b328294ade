"""The command ``avssl``: one sub-command per task, each with options and help of its own."""

import difflib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, make_dataclass
from functools import reduce
from importlib import import_module
from operator import or_
from typing import Annotated, Any

import tyro

from avssl_pyro import __version__
from avssl_pyro.cli.command import run
from avssl_pyro.errors import InputError

PROGRAM = "avssl"
COMPLETION = ("--tyro-print-completion", "--tyro-write-completion")


@dataclass(frozen=True)
class Command:
    """A sub-command.

    Args:
        module: module of :mod:`avssl_pyro.cli`.
        options: name of the dataclass of its options there.
        summary: its work in a few words.
        function: name of the function of the module that runs it.
    """

    module: str
    options: str
    summary: str
    function: str = "main"

    def load(self, name: str) -> Any:
        """An object of the command's module, which is imported only now."""
        return getattr(import_module(f"avssl_pyro.cli.{self.module}"), name)


COMMANDS = {
    "localize": Command("localize", "LocalizeOptions", "estimates the sources of clips and recordings"),
    "prepare": Command("prepare", "PrepareOptions", "cuts recordings into clips to train on"),
    "doctor": Command("doctor", "DoctorOptions", "checks a recording against its array and its camera"),
    "simulate": Command("simulate", "SimulateOptions", "renders labelled scenes as shards"),
    "simulate-recordings": Command(
        "simulate_recordings", "SimulateRecordingsOptions", "renders whole labelled recordings in STARSS23's format"
    ),
    "train": Command("train", "TrainingConfig", "trains the networks on clips without labels"),
    "evaluate": Command("evaluate", "EvaluateOptions", "scores systems beside baselines; makes the paper's tables"),
    "score": Command("score", "ScoreOptions", "scores directions over a recording against its labels"),
    "demo": Command("demo", "DemoOptions", "runs the whole method on scenes made in code"),
    "gallery": Command("gallery", "GalleryOptions", "draws the overlays of scenes chosen by a rule"),
}
BENCHMARKS = {
    "speed": Command("benchmark.systems", "SpeedOptions", "speed and memory", "speed"),
    "elbo": Command("benchmark.systems", "ElboOptions", "Pyro's ELBO and the closed forms", "elbo"),
    "combinations": Command(
        "benchmark.systems", "CombinationsOptions", "priors, likelihoods and guides", "combinations"
    ),
    "calibration": Command(
        "benchmark.systems", "CalibrationOptions", "simulation-based calibration of posteriors", "calibration"
    ),
    "recordings": Command(
        "benchmark.recordings", "RecordingsOptions", "labelled recordings without pictures", "recordings"
    ),
    "rooms": Command("benchmark.rooms", "RoomsOptions", "one, two and no talkers in measured rooms", "rooms"),
    "tracking": Command("benchmark.tracking", "TrackingOptions", "tracks and single windows", "tracking"),
    "separation": Command("benchmark.recordings", "SeparationOptions", "SI-SDR of separated sources", "separation"),
    "camera": Command("benchmark.recordings", "CameraOptions", "yaw and mirror of simulated cameras", "camera"),
}


def main(args: Sequence[str] | None = None) -> int | None:
    """Runs the sub-command that ``args`` (by default those of the process) begin with, and returns its exit code.

    Raises:
        InputError: there is no such sub-command.
        OSError, KeyboardInterrupt: reported in one sentence by :func:`avssl_pyro.cli.command.run`.
    """
    words = list(sys.argv[1:] if args is None else args)
    if words == ["--version"]:
        print(f"{PROGRAM} {__version__}")
        return None
    if words and words[0].startswith(COMPLETION):
        tyro.cli(_all_options(), prog=PROGRAM, args=words)
    if words and words[0] == "benchmark":
        return _run(BENCHMARKS, f"{PROGRAM} benchmark", words[1:])
    return _run(COMMANDS, PROGRAM, words)


def _run(commands: Mapping[str, Command], program: str, words: Sequence[str]) -> int | None:
    if not words or words[0] in ("-h", "--help"):
        print(_help(commands, program))
        return None
    name, *rest = words
    if name not in commands:
        close = difflib.get_close_matches(name, commands, n=1)
        advice = f"did you mean '{program} {close[0]}'?" if close else f"'{program} --help' lists the commands."
        raise InputError(f"'{program}' has no command '{name}'; {advice}")
    code: int | None = commands[name].load(commands[name].function)(rest)
    return code


def _help(commands: Mapping[str, Command], program: str) -> str:
    width = max(map(len, (*COMMANDS, *BENCHMARKS)))
    lines = [f"  {name:{width}}  {command.summary}" for name, command in commands.items()]
    if commands is COMMANDS:
        lines.append(f"  {'benchmark':{width}}  measures speed, accuracy and calibration: {', '.join(BENCHMARKS)}")
        lines += ["", f"'{PROGRAM} --version' prints the version, '{COMPLETION[0]} bash' a completion script."]
    head = f"usage: {program} COMMAND [OPTIONS]; '{program} COMMAND --help' lists the options of one."
    return "\n".join([head, "", *lines])


def _all_options() -> Any:
    """The options of all commands as one type, from which tyro writes the completion of a shell."""

    benchmark = make_dataclass("Benchmark", [("what", _union(BENCHMARKS))], frozen=True)
    return _union(COMMANDS) | _named("benchmark", benchmark)


def _union(commands: Mapping[str, Command]) -> Any:
    kinds = [_named(name, command.load(command.options)) for name, command in commands.items()]
    return reduce(or_, kinds)


def _named(name: str, kind: type) -> Any:
    return Annotated[kind, tyro.conf.subcommand(name=name, prefix_name=False)]


def entry_point() -> None:
    """Runs the installed command and leaves the process with its exit code."""
    run(main)

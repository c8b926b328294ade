"""The command avssl: its help needs no torch, its sub-commands are those of the scripts, its mistakes one sentence."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import get_type_hints

import pytest

from avssl_pyro import __version__
from avssl_pyro.cli import app, options, prepare, simulate
from avssl_pyro.cli.benchmark import recordings
from avssl_pyro.cli.command import EXIT_BAD_INPUT
from avssl_pyro.datasets.generation import SCENES_PER_SHARD
from avssl_pyro.evaluation.baselines import DEFAULT_BAND_HZ
from avssl_pyro.simulation.motion import MovingPeopleConfig

SCRIPTS = Path(__file__).parents[2] / "scripts"
ALL = {**app.COMMANDS, **{f"benchmark {name}": command for name, command in app.BENCHMARKS.items()}}
# Its options are those of simulators, which are made of torch.
HEAVY = {"benchmark tracking"}


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "avssl_pyro", *words], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", sorted(ALL))
def test_every_command_explains_itself(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_info:
        app.main([*name.split(), "--help"])
    assert exit_info.value.code == 0
    assert "--" in capsys.readouterr().out


def test_help_imports_no_torch() -> None:
    modules = sorted({command.module for name, command in ALL.items() if name not in HEAVY})
    code = f"""
import sys
from importlib import import_module
for name in {modules!r}:
    import_module("avssl_pyro.cli." + name)
print([name for name in ("torch", "scipy", "cv2", "matplotlib", "pyroomacoustics") if name in sys.modules])
"""
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert finished.stdout.strip() == "[]"


def test_the_command_runs_as_a_module() -> None:
    assert run("--version").stdout.strip() == f"avssl {__version__}"
    listed = run("--help").stdout
    assert all(f"  {name} " in listed for name in app.COMMANDS)
    assert all(name in run("benchmark").stdout for name in app.BENCHMARKS)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["lokalize"], "'avssl' has no command 'lokalize'; did you mean 'avssl localize'?"),
        (["benchmark", "sped"], "'avssl benchmark' has no command 'sped'; did you mean 'avssl benchmark speed'?"),
        (["xyz"], "'avssl --help' lists the commands."),
    ],
)
def test_a_misspelt_command_gets_one_sentence(
    words: list[str], says: str, refusal: Callable[[Callable[[], int | None]], str]
) -> None:
    assert says in refusal(lambda: app.main(words))
    assert EXIT_BAD_INPUT == 2


def test_completion_knows_the_commands() -> None:
    script = run("--tyro-print-completion", "bash").stdout
    assert all(name in script for name in ("localize", "simulate-recordings", "--checkpoint"))


def test_every_script_runs_a_command() -> None:
    imports = {f"from avssl_pyro.cli.{command.module} import {command.function}" for command in ALL.values()}
    for script in SCRIPTS.glob("*.py"):
        lines = script.read_text(encoding="utf-8").splitlines()
        assert imports & set(lines), script
        assert len(lines) <= 8


def test_defaults_that_options_repeat_are_the_library_s() -> None:
    assert simulate.SimulateOptions.shard_size == prepare.PrepareOptions.shard_size == SCENES_PER_SHARD
    assert recordings.RecordingsOptions.baseline_band_hz == DEFAULT_BAND_HZ
    assert recordings.CameraOptions.standing_share == MovingPeopleConfig.standing_share


def test_shared_options_have_one_type_help_and_default() -> None:
    shared = {
        "seed": (options.Seed, options.DEFAULT_SEED),
        "workers": (options.Workers, options.DEFAULT_WORKERS),
        "device": (options.Device, options.DEFAULT_DEVICE),
    }
    seen = set()
    for command in ALL.values():
        kind = command.load(command.options)
        types = get_type_hints(kind, include_extras=True)
        for field in fields(kind):
            if field.name in shared:
                assert (types[field.name], field.default) == shared[field.name], (command, field.name)
                seen.add(field.name)
    assert seen == set(shared)


@pytest.mark.parametrize(
    "words",
    [["benchmark", "elbo", "--seed", "-1"], ["prepare", "--out", "x", "--seed", "-1"], ["evaluate", "--workers", "0"]],
)
def test_shared_options_out_of_range_are_refused_by_every_command(
    words: list[str], refusal: Callable[[Callable[[], int | None]], str]
) -> None:
    assert f"{words[-2]} is {words[-1]}" in refusal(lambda: app.main(words))

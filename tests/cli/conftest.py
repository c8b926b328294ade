"""What the tests of commands share: a small system, and a command that is refused."""

from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.cli.command import EXIT_BAD_INPUT, run
from avssl_pyro.systems.checkpoint import save_checkpoint
from avssl_pyro.systems.config import GuideConfig
from avssl_pyro.systems.system import SystemConfig, build_system

Refusal = Callable[[Callable[[], int | None]], str]


@pytest.fixture(scope="session")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small, untrained system for the array circle4."""
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("checkpoint") / "small.safetensors"
    narrow = GuideConfig(visual_channels=(4, 8), audio_channels=8)
    save_checkpoint(path, build_system(SystemConfig(PRESETS["circle4"], guide=narrow)))
    return path


@pytest.fixture
def refusal(capsys: pytest.CaptureFixture[str]) -> Refusal:
    """Runs a command that must end as bad input does, and returns its sentence."""

    def message_of(command: Callable[[], int | None]) -> str:
        with pytest.raises(SystemExit) as exit_info:
            run(command)
        assert exit_info.value.code == EXIT_BAD_INPUT
        message = capsys.readouterr().err
        assert message.count("\n") == 1
        return message

    return message_of

"""The state of an interrupted run: weights, optimizer and step in one file, so that they always agree."""

import io
import pickle
from pathlib import Path

import torch

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.errors import InputError
from avssl_pyro.systems.system import System

STATE_NAME = "training_state.pt"


class TrainingState:
    """Reads and writes ``training_state.pt`` of a run.

    Args:
        run_dir: folder of the run.
        system, optimizer: objects that are saved and restored.
    """

    def __init__(self, run_dir: Path, system: System, optimizer: torch.optim.Optimizer) -> None:
        self._path = run_dir / STATE_NAME
        self._system = system
        self._optimizer = optimizer

    def load(self) -> int:
        """Restores the state if there is one.

        Returns:
            The number of steps already done.

        Raises:
            InputError: the file is damaged or belongs to another configuration.
        """
        if not self._path.exists():
            return 0
        hint = "give another --out, or delete the file to start over"
        try:
            state = torch.load(self._path, map_location="cpu", weights_only=True)
            self._system.load_state_dict(state["weights"])
            self._optimizer.load_state_dict(state["optimizer"])
        except (RuntimeError, KeyError, EOFError, ValueError, pickle.UnpicklingError) as error:
            problem = " ".join(str(error).split())[:200]
            raise InputError(f"{self._path}: cannot be resumed from ({problem}); {hint}.") from error
        return int(state["step"])

    def save(self, step: int) -> None:
        """Writes the state after ``step`` steps, all of it or nothing."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        buffer = io.BytesIO()
        torch.save(
            {"step": step, "weights": self._system.state_dict(), "optimizer": self._optimizer.state_dict()}, buffer
        )
        write_atomically(self._path, buffer.getvalue())

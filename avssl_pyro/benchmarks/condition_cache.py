"""Finished cells of the experiment on disk, so that a stopped command goes on where it was."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from avssl_pyro.atomic_file import remove_temporaries, write_atomically
from avssl_pyro.benchmarks.condition import ConditionResult, cell_from_dict, cell_to_dict
from avssl_pyro.errors import InputError

FORMAT = "avssl-cell/3"


@dataclass(frozen=True)
class ConditionCache:
    """A folder with one JSON file per finished cell, named by what it was made of.

    Args:
        folder: made when the first cell is kept.
    """

    folder: Path

    def path(self, name: str, facts: dict[str, Any]) -> Path:
        """Where the cell called ``name`` is kept; other facts (weights, scenes, settings) lead to another file."""
        digest = hashlib.sha256(json.dumps({"format": FORMAT, **facts}, sort_keys=True).encode()).hexdigest()
        return self.folder / f"{name}-{digest[:16]}.json"

    def get_or_run(self, name: str, facts: dict[str, Any], run: Callable[[], ConditionResult]) -> ConditionResult:
        """The kept cell of these facts, or a new one by ``run``, which is then kept.

        Raises:
            InputError: the kept file is damaged.
            OSError: the new one cannot be written; nothing is left behind.
        """
        path = self.path(name, facts)
        if path.exists():
            return _read(path)
        data = cell_to_dict(run())
        self.folder.mkdir(parents=True, exist_ok=True)
        remove_temporaries(self.folder)
        content = {"format": FORMAT, "of": facts, **data}
        write_atomically(path, json.dumps(content, allow_nan=False).encode())
        # As it will be read again, so that a run that was stopped and one that was not say the same to the last digit.
        return cell_from_dict(data)


def _read(path: Path) -> ConditionResult:
    try:
        return cell_from_dict(json.loads(path.read_text(encoding="utf-8")))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: damaged ({type(error).__name__}: {error}); delete it and run the same command again."
        ) from error

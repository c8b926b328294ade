"""Ranks of finished trials on disk, so that a stopped calibration goes on where it was."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.benchmarks.sbc_toy_model import SmallSystem
from avssl_pyro.criticism.sbc import Sampler, run_trials
from avssl_pyro.errors import InputError

FORMAT = "avssl-calibration/1"


@dataclass(frozen=True)
class CalibrationStore:
    """A folder with one file for every batch of trials of every posterior.

    Args:
        folder: made when the first batch is kept.
        system: what is calibrated; another system has other files.
    """

    folder: Path
    system: SmallSystem

    def path(self, posterior: str, seeds: Sequence[int]) -> Path:
        """Where the ranks of these trials are kept."""
        facts = {"format": FORMAT, "system": asdict(self.system), "seeds": list(seeds)}
        digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
        return self.folder / f"{posterior.replace(' ', '-')}-{seeds[0]:05d}-{digest[:12]}.json"

    def get_or_run(self, posterior: str, sampler: Sampler, seeds: Sequence[int]) -> list[dict[str, int]]:
        """Ranks of every quantity, one row a trial.

        Raises:
            InputError: a kept file is damaged.
            OSError: a new one cannot be written.
        """
        path = self.path(posterior, seeds)
        if path.exists():
            return _read(path)
        trials = run_trials(self.system.model(), {posterior: sampler}, self.system.spectrogram(), seeds)
        rows = [dict(trial[posterior]) for trial in trials]
        self.folder.mkdir(parents=True, exist_ok=True)
        write_atomically(path, json.dumps({"format": FORMAT, "ranks": rows}).encode())
        return rows


def _read(path: Path) -> list[dict[str, int]]:
    try:
        rows: list[dict[str, int]] = json.loads(path.read_text(encoding="utf-8"))["ranks"]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged ({error}); delete it and run the same command again.") from error
    return rows

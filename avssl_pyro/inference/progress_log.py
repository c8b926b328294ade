"""The record of a run: one JSON line per logged step, and the same numbers as TensorBoard events."""

import json
from pathlib import Path
from typing import Any

from torch.utils.tensorboard import SummaryWriter

LOG_NAME = "log.jsonl"


class ProgressLog:
    """Appends records; what a run wrote after the step it is resumed from is dropped first.

    Args:
        run_dir: folder of the run.
        first_step: steps already done.
    """

    def __init__(self, run_dir: Path, first_step: int) -> None:
        run_dir.mkdir(parents=True, exist_ok=True)
        path = run_dir / LOG_NAME
        kept = [record for record in read_log(run_dir) if record["step"] <= first_step] if path.exists() else []
        self._file = path.open("w", encoding="utf-8")
        self._file.writelines(json.dumps(record) + "\n" for record in kept)
        self._file.flush()
        self._events = SummaryWriter(str(run_dir / "tensorboard"), purge_step=first_step + 1 if first_step else None)

    def write(self, record: dict[str, Any]) -> None:
        """Writes one record; it must have a ``step``."""
        self._file.write(json.dumps(record) + "\n")
        self._file.flush()
        for name, value in record.items():
            if name != "step":
                self._events.add_scalar(name, value, record["step"])

    def close(self) -> None:
        self._file.close()
        self._events.close()


def read_log(run_dir: Path) -> list[dict[str, Any]]:
    """The records of a run, oldest first; a line cut short by a kill is left out."""
    records = []
    for line in (run_dir / LOG_NAME).read_text(encoding="utf-8").splitlines():
        try:
            records.append(json.loads(line))
        except json.JSONDecodeError:
            break
    return records

"""Metrics of a run: a progress bar, one JSON line per logged step, and TensorBoard events."""

import json
import time
from pathlib import Path
from typing import Any

from lightning_fabric.loggers.tensorboard import TensorBoardLogger
from tqdm import tqdm

from avssl_pyro.atomic_file import write_atomically

LOG_NAME = "log.jsonl"


class MetricsLogger:
    """Shows and stores metrics of a run; a disabled logger does neither.

    Args:
        run_dir: folder of the run.
        first_step: number of steps already done; later records of an earlier process are dropped.
        total_steps: number of steps of the whole run.
        clips_per_step: number of clips per step over all processes.
        enabled: whether this process logs; one process of a run does.
    """

    def __init__(
        self, run_dir: Path, *, first_step: int, total_steps: int, clips_per_step: int, enabled: bool = True
    ) -> None:
        self._clips_per_step = clips_per_step
        self._logged_step, self._logged_at = first_step, time.monotonic()
        self._bar = tqdm(
            total=total_steps * clips_per_step,
            initial=first_step * clips_per_step,
            unit="clip",
            desc="training",
            disable=not enabled,
            smoothing=0.05,
            mininterval=0.5,
        )
        self._enabled = enabled
        if not enabled:
            return
        run_dir.mkdir(parents=True, exist_ok=True)
        kept = [record for record in read_log(run_dir) if record["step"] <= first_step]
        write_atomically(run_dir / LOG_NAME, "".join(f"{json.dumps(record)}\n" for record in kept).encode())
        self._file = (run_dir / LOG_NAME).open("a", encoding="utf-8")
        self._tensorboard = TensorBoardLogger(
            run_dir, name="tensorboard", version="", purge_step=first_step + 1 if first_step else None
        )

    def advance(self) -> None:
        """Counts one step."""
        self._bar.update(self._clips_per_step)

    def record(self, step: int, values: dict[str, float]) -> None:
        """Stores the values of a step with the clips per second since the last record, and shows the ELBO's terms."""
        if not self._enabled:
            return
        now = time.monotonic()
        clips = (step - self._logged_step) * self._clips_per_step
        values = {**values, "clips_per_second": clips / max(now - self._logged_at, 1e-9)}
        self._logged_step, self._logged_at = step, now
        self._file.write(json.dumps({"step": step, **values}) + "\n")
        self._file.flush()
        self._tensorboard.log_metrics(values, step)
        kl = "".join(f" - {name} {value:.4f}" for name, value in values.items() if name.startswith("kl_"))
        gain = f"gain {values['elbo_gain']:.3f}; " if "elbo_gain" in values else ""
        self._bar.set_postfix_str(f"{gain}elbo {-values['loss']:.3f} = lik {values['log_likelihood']:.3f}{kl}")

    def close(self) -> None:
        """Ends the bar and closes the files."""
        self._bar.close()
        if self._enabled:
            self._file.close()
            self._tensorboard.finalize("success")


def read_log(run_dir: Path) -> list[dict[str, Any]]:
    """The records of a run, oldest first; none if there is no log. A line cut short by a kill ends it."""
    path = run_dir / LOG_NAME
    records: list[dict[str, Any]] = []
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            try:
                records.append(json.loads(line))
            except json.JSONDecodeError:
                break
    return records

"""Measures speed and memory."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.benchmarks.speed import SpeedConfig, measure_speed
from avssl_pyro.errors import InputError


@dataclass(frozen=True)
class BenchmarkOptions:
    """Time training steps, reading and localization, and measure their memory, on clips of noise."""

    array: str = "circle6"
    """Microphone array."""
    batch_size: int = 16
    """Clips per training step."""
    repeats: int = 20
    """Timings of each thing; medians are shown."""
    data: tuple[Path, ...] = ()
    """Folders of shards to read; by default a few scenes made for the purpose."""

    def __post_init__(self) -> None:
        if self.repeats < 2 or self.batch_size < 1:
            raise InputError(
                f"--repeats {self.repeats} and --batch-size {self.batch_size} must be at least 2 and at least 1."
            )


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process)."""
    options = tyro.cli(BenchmarkOptions, args=args)
    config = SpeedConfig(resolve_array(options.array), options.batch_size, options.repeats, options.data)
    for table in measure_speed(config):
        table.print()

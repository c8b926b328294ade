"""Simulation-based calibration: are the posteriors on offer as wide as the posterior is?"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import tyro
from rich import box
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.benchmarks.sbc_cache import CalibrationStore
from avssl_pyro.benchmarks.sbc_toy_model import SmallSystem
from avssl_pyro.criticism.sbc import Uniformity, rank_histogram, uniformity
from avssl_pyro.errors import InputError
from avssl_pyro.viz.rank_histograms import save_rank_histograms


@dataclass(frozen=True)
class CalibrateOptions:
    """Draw scenes from a small model, fit posteriors to them, and test whether the truth ranks uniformly among draws.

    Writes ranks.json and ranks.png. Finished batches are kept in the folder; a stopped command goes on where it was.
    """

    out: Path
    """Folder of the results."""
    posteriors: tuple[str, ...] = ("refined", "mean field")
    """Any of: 'refined', 'mean field', 'low rank', 'NUTS'; the last two are slow."""
    trials: int = 60
    """Scenes to draw; 200 tell more."""
    batch: int = 20
    """Scenes that are kept together, and sampled together by NUTS."""
    seed: int = 0
    """Of the first scene; the others count up."""


def main(args: Sequence[str] | None = None) -> int:
    """Runs the command with ``args`` (by default those of the process) and returns its exit code."""
    options = tyro.cli(CalibrateOptions, args=args)
    if options.trials < 1 or options.batch < 1:
        raise InputError(f"--trials {options.trials} and --batch {options.batch} must be at least 1.")
    if not options.posteriors:
        raise InputError("--posteriors: name at least one.")
    system = SmallSystem()
    samplers = system.samplers()
    if unknown := [name for name in options.posteriors if name not in samplers]:
        raise InputError(f"--posteriors: there is no '{unknown[0]}'; choose from {', '.join(samplers)}.")
    store = CalibrationStore(options.out / "trials", system)
    ranks: dict[str, dict[str, list[int]]] = {}
    for posterior in options.posteriors:
        rows: list[dict[str, int]] = []
        starts = range(options.seed, options.seed + options.trials, options.batch)
        for start in tqdm(starts, desc=posterior, unit="batch"):
            seeds = range(start, min(start + options.batch, options.seed + options.trials))
            rows += store.get_or_run(posterior, samplers[posterior], seeds)
        ranks[posterior] = {name: [row[name] for row in rows] for name in rows[0]}
    _report(options.out, system.draws, ranks)
    return 0


def _report(out: Path, draws: int, ranks: dict[str, dict[str, list[int]]]) -> None:
    found = {
        posterior: {name: uniformity(rank_n, draws) for name, rank_n in by_quantity.items()}
        for posterior, by_quantity in ranks.items()
    }
    Console().print(_table(found))
    content = {
        "draws": draws,
        "ranks": ranks,
        "uniformity": {p: {name: asdict(u) for name, u in rows.items()} for p, rows in found.items()},
    }
    write_atomically(out / "ranks.json", json.dumps(content, indent=1).encode())
    save_rank_histograms(
        out / "ranks.png",
        {p: {name: rank_histogram(r, draws) for name, r in rows.items()} for p, rows in ranks.items()},
        {p: {name: u.p_value for name, u in rows.items()} for p, rows in found.items()},
    )
    print(f"{out / 'ranks.json'}: written, and ranks.png beside it.")


def _table(found: dict[str, dict[str, Uniformity]]) -> Table:
    table = Table(
        title="p of uniform ranks | their spread (above 1: too narrow a posterior) | their shift (above 0: too low)",
        box=box.SIMPLE_HEAD,
        title_justify="left",
    )
    table.add_column("quantity")
    for posterior in found:
        table.add_column(posterior, justify="right")
    for name in next(iter(found.values())):
        cells = (by_quantity[name] for by_quantity in found.values())
        table.add_row(name, *(f"{u.p_value:.2g} | {u.spread:.2f} | {u.shift:+.2f}" for u in cells))
    return table

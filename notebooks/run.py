"""Executes one notebook in a kernel of its own and keeps the executed copy. Warnings in a notebook are errors.

The cell tagged ``parameters`` holds the sizes of a notebook, and its metadata, under ``short``, the values that a test
can wait for; ``--short`` runs the notebook with those.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nbformat
import tyro
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from avssl_pyro.atomic_file import write_atomically

CELL_TIMEOUT_S = 600
# The kernel warns of itself when it shuts down, and ArviZ of its own future, once a day.
WARNINGS = "w.simplefilter('error'); w.filterwarnings('ignore', module='ipykernel|arviz')"
KERNEL_ARGUMENTS = [
    f"--IPKernelApp.exec_lines=import warnings as w; {WARNINGS}; del w",
    "--IPKernelApp.log_level=ERROR",
]


@dataclass(frozen=True)
class RunOptions:
    """Execute a notebook and keep the executed copy."""

    notebook: tyro.conf.Positional[Path]
    """The notebook, .ipynb; it is not changed."""
    out: Path = Path("build/notebooks")
    """Folder for the executed copy, which has the notebook's name."""
    short: bool = False
    """Use the short parameters."""


def tagged(notebook: Any, tag: str) -> list[Any]:
    """The cells of a notebook that have a tag."""
    return [cell for cell in notebook.cells if tag in cell.metadata.get("tags", ())]


def shortened(notebook: Any) -> Any:
    """The notebook with a cell after its parameters that sets the short ones."""
    (parameters,) = tagged(notebook, "parameters")
    lines = [f"{name} = {value!r}" for name, value in parameters.metadata["short"].items()]
    cell = nbformat.v4.new_code_cell("\n".join(lines), id="short", metadata={"tags": ["injected-parameters"]})
    notebook.cells.insert(notebook.cells.index(parameters) + 1, cell)
    return notebook


def execute(notebook: Any, folder: Path) -> Any:
    """Runs all cells, in ``folder``, and fills in their outputs.

    Raises:
        CellExecutionError: a cell raises, or warns.
    """
    client = NotebookClient(
        notebook,
        timeout=CELL_TIMEOUT_S,
        kernel_name="python3",
        extra_arguments=KERNEL_ARGUMENTS,
        resources={"metadata": {"path": str(folder)}},
        record_timing=False,
    )
    return client.execute()


def main() -> int:
    options = tyro.cli(RunOptions)
    notebook = nbformat.read(options.notebook, as_version=4)
    if options.short:
        notebook = shortened(notebook)
    options.out.mkdir(parents=True, exist_ok=True)
    try:
        execute(notebook, options.out)
    except CellExecutionError as error:
        print(f"{options.notebook}: {error}", file=sys.stderr)
        return 1
    write_atomically(options.out / options.notebook.name, nbformat.writes(notebook).encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())

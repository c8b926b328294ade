"""The notebooks are stored clean, run as they stand, and what they tell a user to write is short."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).parent.parent
RUNNER = ROOT / "notebooks" / "run.py"
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
NAMES = [
    "1-tour",
    "2-swapping-priors",
    "3-swapping-guides",
    "4-elbo-and-closed-forms",
    "5-your-own-array",
]
# What a user writes to have a prior, a likelihood or a guide of one's own.
OWN_CELLS = {"2-swapping-priors": 2, "3-swapping-guides": 1}
MOST_OWN_LINES = 15
# Of any cell but that of the imports.
MOST_LINES = 18

each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def cells(path, tag=None):
    notebook = nbformat.read(path, as_version=4)
    return [cell for cell in notebook.cells if tag is None or tag in cell.metadata.get("tags", ())]


def code_lines(cell):
    """Lines that are neither empty nor a comment alone."""
    lines = [line.strip() for line in cell.source.splitlines()]
    return [line for line in lines if line and not line.startswith("#")]


def run(path, out, *options):
    command = [sys.executable, str(RUNNER), str(path), "--out", str(out), *options]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_all_notebooks_are_there():
    assert [path.stem for path in NOTEBOOKS] == NAMES


@each_notebook
def test_a_notebook_is_stored_without_results(path):
    nbformat.validate(nbformat.read(path, as_version=4))
    assert json.loads(path.read_text(encoding="utf-8"))["metadata"]["kernelspec"]["name"] == "python3"
    for cell in cells(path):
        if cell.cell_type == "code":
            assert not cell.outputs
            assert cell.execution_count is None


@each_notebook
def test_short_values_replace_parameters_that_are_there(path):
    (parameters,) = cells(path, "parameters")
    first_code = next(cell for cell in cells(path) if cell.cell_type == "code")
    assert parameters == first_code
    names = {node.id for node in ast.walk(ast.parse(parameters.source)) if isinstance(node, ast.Name)}
    assert set(parameters.metadata["short"]) <= names


@each_notebook
def test_a_notebook_has_a_title_and_small_cells(path):
    assert cells(path)[0].source.startswith("# ")
    for cell in cells(path):
        if cell.cell_type == "code" and "%matplotlib" not in cell.source:
            assert len(code_lines(cell)) <= MOST_LINES, cell.source


@pytest.mark.parametrize("name", OWN_CELLS)
def test_a_prior_a_likelihood_and_a_guide_take_fifteen_lines_each(name):
    own = cells(ROOT / "notebooks" / f"{name}.ipynb", "own")
    assert len(own) == OWN_CELLS[name]
    for cell in own:
        assert 0 < len(code_lines(cell)) <= MOST_OWN_LINES, cell.source


@each_notebook
def test_a_notebook_runs_in_short(path, tmp_path):
    before = path.read_bytes()
    finished = run(path, tmp_path, "--short")
    assert finished.returncode == 0, finished.stderr
    assert path.read_bytes() == before
    executed = cells(tmp_path / path.name)
    assert all(cell.execution_count for cell in executed if cell.cell_type == "code")
    # Pictures are shown, and nothing is said on the side.
    kinds = {kind for cell in executed for output in cell.get("outputs", ()) for kind in output.get("data", ())}
    assert "image/png" in kinds
    assert not [output for cell in executed for output in cell.get("outputs", ()) if output.get("name") == "stderr"]


def small_notebook(folder, *sources):
    parameters = nbformat.v4.new_code_cell("size = 100", metadata={"tags": ["parameters"], "short": {"size": 2}})
    rest = [nbformat.v4.new_code_cell(source) for source in sources]
    path = folder / "small.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=[parameters, *rest]), path)
    return path


def test_the_runner_shortens_only_if_asked(tmp_path):
    path = small_notebook(tmp_path, "print('size', size)")
    for options, size in (((), 100), (("--short",), 2)):
        assert run(path, tmp_path / "out", *options).returncode == 0
        assert cells(tmp_path / "out" / path.name)[-1].outputs[0].text == f"size {size}\n"


def test_a_warning_in_a_notebook_is_an_error_and_leaves_nothing(tmp_path):
    path = small_notebook(tmp_path, "import warnings", "warnings.warn('beware', DeprecationWarning)")
    finished = run(path, tmp_path / "out")
    assert finished.returncode == 1
    assert "DeprecationWarning" in finished.stderr
    assert "beware" in finished.stderr
    assert not list((tmp_path / "out").iterdir())

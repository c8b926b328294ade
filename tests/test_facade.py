"""`import avssl_pyro as av`: the public names, and what importing them costs."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import avssl_pyro as av

ROOT = Path(__file__).resolve().parent.parent
HEAVY = ("torch", "numpy", "pyro", "scipy", "matplotlib", "cv2")


def loaded_after(code: str) -> set[str]:
    """The modules that a fresh Python has loaded after ``code``."""
    command = [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"]
    return set(subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split())


@pytest.mark.parametrize(
    "code", ["import avssl_pyro", "import avssl_pyro as av; dir(av); av.__version__; av.InputError"]
)
def test_importing_costs_nothing_until_something_is_used(code: str) -> None:
    assert not loaded_after(code) & set(HEAVY)


@pytest.mark.parametrize("name", av.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert name in dir(av)
    value = getattr(av, name)
    assert value.__name__ == name
    # One object, wherever it is imported from, and the facade has it from its own module.
    assert getattr(importlib.import_module(value.__module__), name) is value
    assert value.__module__ == f"avssl_pyro.{av._MODULES[name]}"


def test_type_checkers_see_the_same_names() -> None:
    block = next(node for node in ast.parse(Path(av.__file__).read_text()).body if isinstance(node, ast.If))
    seen = {
        alias.name: str(node.module).removeprefix("avssl_pyro.")
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == av._MODULES
    assert sorted(seen) == sorted(av.__all__)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'avssl_pyro' has no attribute 'localise'"):
        av.localise  # noqa: B018


@pytest.mark.parametrize("folder", ["tests", "scripts", "notebooks", "avssl_pyro"])
def test_the_rest_of_a_checkout_is_no_part_of_the_package(folder: str) -> None:
    assert importlib.util.find_spec(f"avssl_pyro.{folder}") is None

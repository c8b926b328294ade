"""The package is the same wherever Python starts, and its imports go one way."""

import ast
import importlib
import json
import os
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
# Folders of the package that lie outside avssl_pyro/.
MAPPED = ("models", "guides")
MOST_LINES = 320

# From the bottom up: a package may import itself and what is in the layers below.
LAYERS = [
    {"errors"},
    {"atomic_file", "interruption", "validators"},
    {"acoustics"},
    {"clip"},
    {"batch", "networks", "distributions"},
    {"models"},
    {"io"},
    {"simulation"},
    {"guides"},
    {"datasets"},
    {"recordings"},
    {"systems"},
    {"training"},
    {"localization"},
    {"diagnosis"},
    {"tracking"},
    {"separation"},
    {"criticism"},
    {"evaluation"},
    {"viz"},
    {"api"},
    {"benchmarks"},
    {"cli"},
    {"__main__"},
]


def python_files() -> Iterator[tuple[str, Path]]:
    """Every module of the package by its dotted name below avssl_pyro, with its file."""
    for folder in (ROOT / "avssl_pyro", *(ROOT / name for name in MAPPED)):
        base = folder if folder.name == "avssl_pyro" else ROOT
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(base).with_suffix("").parts
            yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


MODULES = dict(python_files())


def imported(path: Path) -> Iterator[str]:
    """The dotted names a module imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert node.module is not None
            # `from avssl_pyro.data import clip` imports a module, `from avssl_pyro.clip import Clip` a name.
            yield from (
                f"{node.module}.{alias.name}" if f"{node.module}.{alias.name}" in submodules() else node.module
                for alias in node.names
            )


def submodules() -> set[str]:
    return {f"avssl_pyro.{name}" for name in MODULES}


def layer(name: str) -> int:
    (index,) = (index for index, packages in enumerate(LAYERS) if name.split(".", maxsplit=1)[0] in packages)
    return index


def test_the_layer_plan_of_the_documentation_is_this_one() -> None:
    """docs/architecture.md draws the layers from the top down, one line each."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    plan = text.split("```text\n")[1].split("```")[0]
    # A package is a name before the bar; what it holds stands behind.
    drawn = [set(line.split("|")[0].split()) for line in plan.splitlines() if "|" in line]
    assert drawn == LAYERS[::-1]


def may_import(importer: str, target: str) -> bool:
    package, other = importer.split(".", maxsplit=1)[0], target.split(".", maxsplit=1)[0]
    if package == other:
        return True
    return layer(other) < layer(package)


def test_the_rule_knows_up_from_down() -> None:
    assert may_import("datasets.encoding", "simulation.scenes")
    assert may_import("simulation.scenes", "clip")
    assert not may_import("simulation.scenes", "datasets.encoding")
    assert not may_import("io.images", "systems.system")
    assert not may_import("models.priors", "guides.amortized")
    assert not may_import("networks.audio", "cli.train")
    assert may_import("cli.train", "networks.audio")


@pytest.mark.parametrize("module", [name for name in MODULES if name])
def test_imports_go_one_way(module: str) -> None:
    own = [name.removeprefix("avssl_pyro.") for name in imported(MODULES[module]) if name.startswith("avssl_pyro.")]
    upward = [name for name in own if not may_import(module, name)]
    assert not upward, f"{module} imports {upward}"


def test_networks_and_acoustics_know_nothing_of_pyro() -> None:
    for module, path in MODULES.items():
        if module.split(".")[0] in {
            "networks",
            "acoustics",
            "io",
            "datasets",
            "recordings",
            "simulation",
            "evaluation",
            "viz",
        }:
            assert "pyro" not in {name.split(".")[0] for name in imported(path)}, module


def test_modules_say_what_they_are_about_and_stay_readable() -> None:
    for module, path in MODULES.items():
        assert path.stem not in {"utils", "util", "helpers", "helper", "common", "misc"}, module
        assert len(path.read_text(encoding="utf-8").splitlines()) <= MOST_LINES, module


def test_package_list_is_the_tree() -> None:
    folders = {
        ".".join(path.parent.relative_to(ROOT).parts)
        for folder in ("avssl_pyro", *MAPPED)
        for path in (ROOT / folder).rglob("__init__.py")
    }
    tree = {f"avssl_pyro.{name}" if name.split(".")[0] in MAPPED else name for name in folders}
    assert sorted(PROJECT["tool"]["setuptools"]["packages"]) == sorted(tree)
    # A folder of modules without __init__.py would be left out of the wheel without a word.
    with_modules = {path.parent for _, path in python_files()}
    assert all((folder / "__init__.py").is_file() for folder in with_modules)


@pytest.mark.parametrize("package", [name for name, path in MODULES.items() if name and path.name == "__init__.py"])
def test_a_package_lists_its_public_modules(package: str) -> None:
    folder = MODULES[package].parent
    modules = [path.stem for path in folder.glob("*.py")] + [path.parent.name for path in folder.glob("*/__init__.py")]
    assert importlib.import_module(f"avssl_pyro.{package}").__all__ == sorted(
        name for name in modules if not name.startswith("_")
    )


def python(code: str, folder: Path, **environment: str) -> str:
    """What a fresh Python started in ``folder`` prints."""
    finished = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    return finished.stdout.strip()


# Finding a module imports its parents only, which is quick.
WHERE = """
from importlib.util import find_spec
print(*(find_spec("avssl_pyro" + name).origin for name in ("", ".models.priors", ".guides.amortized")))
"""


def test_editable_install_imports_the_same_files_from_anywhere(tmp_path: Path) -> None:
    inside = python(WHERE, ROOT)
    assert python(WHERE, tmp_path) == inside
    assert inside.split()[1] == str(ROOT / "models" / "priors.py")


def test_models_and_guides_take_no_names_from_others(tmp_path: Path) -> None:
    found = "import importlib.util as u; print([u.find_spec(name) is not None for name in ('models', 'guides')])"
    assert python(found, tmp_path) == "[False, False]"


def test_the_package_never_makes_a_second_class_object() -> None:
    """Importing everything leaves no top-level `models` or `guides` behind."""
    names = [f"avssl_pyro.{name}" for name in MODULES if name]
    code = f"""
import importlib, sys
for name in {names!r}:
    importlib.import_module(name)
print([name for name in sys.modules if name.split('.')[0] in ('models', 'guides')])
"""
    assert python(code, ROOT) == "[]"


@pytest.mark.parametrize("line", ["import models", "from guides import amortized", "import models.priors as priors"])
def test_top_level_imports_are_banned_by_the_linter(line: str) -> None:
    command = [sys.executable, "-m", "ruff", "check", "--config", str(ROOT / "pyproject.toml"), "--select", "TID"]
    finished = subprocess.run(
        [*command, "--output-format", "concise", "-"], input=f"{line}\n", capture_output=True, text=True, check=False
    )
    assert finished.returncode == 1
    assert "TID251" in finished.stdout
    assert "second class object" in finished.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel built from a copy of the sources, so that nothing is left in the checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "LICENSE", "avssl_pyro", *MAPPED):
        (source / name).symlink_to(ROOT / name)
    # The readme is only quoted in the metadata.
    readme = ROOT / "README.md"
    (source / "README.md").write_text(readme.read_text() if readme.is_file() else "")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(source)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    (path,) = folder.glob("*.whl")
    return path


def test_wheel_holds_exactly_the_modules(wheel: Path) -> None:
    inside = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    package = ROOT / "avssl_pyro"
    expected = {
        path.relative_to(package if path.is_relative_to(package) else ROOT).as_posix() for path in MODULES.values()
    }
    weights = {f"weights/{path.name}" for path in (package / "weights").iterdir()}
    assert inside == {f"avssl_pyro/{name}" for name in (*expected, *weights, "py.typed")}


def test_wheel_works_in_the_checkout_and_elsewhere(wheel: Path, tmp_path: Path) -> None:
    target = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(target)
    code = "import avssl_pyro.models.spatial_cgmm as m, avssl_pyro.guides.amortized as g; print(m.__file__, g.__file__)"
    elsewhere = python(code, tmp_path, PYTHONPATH=str(target)).split()
    package = target / "avssl_pyro"
    assert elsewhere == [str(package / "models" / "spatial_cgmm.py"), str(package / "guides" / "amortized.py")]
    # Started in the checkout, the checkout shadows the wheel, and finds its own models and guides.
    inside = python(code, ROOT, PYTHONPATH=str(target)).split()
    assert inside == [str(ROOT / "models" / "spatial_cgmm.py"), str(ROOT / "guides" / "amortized.py")]


# What a user does first, in a folder that holds nothing.
FRONT_DOOR = """
import avssl_pyro as av
from avssl_pyro.systems.config import GuideConfig
from avssl_pyro.training.config import OptimizationConfig
scenes = av.simulate("scenes", 4, array="circle2", workers=1)
small = {"guide": GuideConfig(visual_channels=(4, 8), audio_channels=4)}
short = {"optimization": OptimizationConfig(epochs=1, batch_size=4, num_workers=0)}
trained = av.train("quick", data="scenes", array="circle2", out="run", **small, **short)
for model in (av.load("circle2"), trained):
    result = model.localize(scenes[0].audio_mn, scenes[0].image_ijc)
    print(result.to_dict()["format"], result.plot().shape[1])
print(av.__file__)
import soundfile
soundfile.write("clip.wav", scenes[0].audio_mn.T, 16_000, subtype="FLOAT")
"""
COMMAND = """
import sys
from avssl_pyro.cli.app import entry_point
sys.argv[1:] = {words!r}
entry_point()
"""


def test_a_wheel_simulates_trains_and_localizes_outside_the_checkout(wheel: Path, tmp_path: Path) -> None:
    target, folder = tmp_path / "site", tmp_path / "empty"
    zipfile.ZipFile(wheel).extractall(target)
    folder.mkdir()
    said = python(FRONT_DOOR, folder, PYTHONPATH=str(target), OMP_NUM_THREADS="1").split()
    assert said == ["avssl-result/1", "1152"] * 2 + [str(target / "avssl_pyro" / "__init__.py")]
    version = python(COMMAND.format(words=["--version"]), folder, PYTHONPATH=str(target))
    assert version == f"avssl {PROJECT['project']['version']}"
    words = ["localize", "--audio", "clip.wav", "--array", "circle2"]
    result = json.loads(python(COMMAND.format(words=words), folder, PYTHONPATH=str(target), OMP_NUM_THREADS="1"))
    assert (result["format"], result["audio"]) == ("avssl-result/1", "clip.wav")
    with zipfile.ZipFile(wheel) as archive:
        (scripts,) = (name for name in archive.namelist() if name.endswith(".dist-info/entry_points.txt"))
        assert "avssl = avssl_pyro.cli.app:entry_point" in archive.read(scripts).decode()


def test_imports_need_nothing_that_only_unix_has() -> None:
    for module, path in MODULES.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in tree.body:
            names = {alias.name for alias in node.names} if isinstance(node, ast.Import) else set()
            names |= {node.module or ""} if isinstance(node, ast.ImportFrom) else set()
            assert not names & {"fcntl", "resource", "pwd", "grp", "termios"}, module

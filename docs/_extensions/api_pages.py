"""Writes a page for every module of every package that pyproject.toml lists, so that none can be forgotten."""

import ast
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "api"
INTRODUCTION = "Every public class and function. :doc:`/method` says which equation is written where."


@dataclass(frozen=True)
class Module:
    """A module or package: its dotted name, its file, and the modules inside it."""

    name: str
    path: Path
    inside: tuple["Module", ...] = ()

    @property
    def entry(self) -> str:
        """A line of a list: a link to its page and what its docstring says first."""
        docstring = ast.get_docstring(ast.parse(self.path.read_text(encoding="utf-8"))) or ""
        return f":doc:`{self.name}`\n   {docstring.partition(chr(10))[0]}\n"

    @property
    def page(self) -> str:
        title = self.name.removeprefix("avssl_pyro.") if self.inside else self.name.rpartition(".")[2]
        return heading(title) + f".. automodule:: {self.name}\n\n" + listing(self.inside)


def heading(title: str) -> str:
    return f"{title}\n{'=' * len(title)}\n\n"


def listing(modules: tuple[Module, ...]) -> str:
    """The modules with links to their pages, for reading and for the sidebar."""
    if not modules:
        return ""
    names = "".join(f"   {module.name}\n" for module in modules)
    return "\n".join(module.entry for module in modules) + f"\n.. toctree::\n   :hidden:\n\n{names}"


def packages() -> tuple[Module, ...]:
    """Every package with the modules inside it."""
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    found = []
    for name in setuptools["packages"]:
        folder = ROOT / setuptools["package-dir"].get(name, name.replace(".", "/"))
        files = sorted(path for path in folder.glob("*.py") if not path.stem.startswith("_"))
        modules = tuple(Module(f"{name}.{path.stem}", path) for path in files)
        found.append(Module(name, folder / "__init__.py", modules))
    return tuple(found)


def pages() -> dict[str, str]:
    """The reStructuredText of every page by its file name."""
    modules = [module for package in packages() for module in (package, *package.inside)]
    index = heading("API") + INTRODUCTION + "\n\n" + listing(packages())
    return {"index": index} | {module.name: module.page for module in modules}


def write_pages(_: Sphinx) -> None:
    """Leaves alone what has not changed, so that it is not built anew, and removes pages of modules that are gone."""
    PAGES.mkdir(exist_ok=True)
    texts = {PAGES / f"{name}.rst": text for name, text in pages().items()}
    for path in set(PAGES.iterdir()) - texts.keys():
        path.unlink()
    for path, text in texts.items():
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

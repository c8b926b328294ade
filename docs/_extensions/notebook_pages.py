"""Brings the notebooks into the site: with outputs where they have been executed, as they are stored otherwise."""

import json
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
STORED = ROOT / "notebooks"
EXECUTED = ROOT / "build" / "notebooks"
PAGES = ROOT / "docs" / "notebooks"


def freshest(stored: Path) -> Path:
    """The executed copy, unless the notebook was changed since."""
    executed = EXECUTED / stored.name
    return executed if executed.is_file() and executed.stat().st_mtime >= stored.stat().st_mtime else stored


def title(notebook: str) -> str:
    """The first heading."""
    lines = (line for cell in json.loads(notebook)["cells"] for line in "".join(cell["source"]).splitlines())
    return next(line.removeprefix("# ") for line in lines if line.startswith("# "))


def write_pages(_: Sphinx) -> None:
    """Leaves alone what has not changed, so that it is not built anew."""
    PAGES.mkdir(exist_ok=True)
    texts = {path.name: freshest(path).read_text(encoding="utf-8") for path in sorted(STORED.glob("*.ipynb"))}
    links = "".join(f"- [{title(text)}]({name})\n" for name, text in texts.items())
    names = "\n".join(texts)
    texts["index.md"] = f"# Notebooks\n\n{links}\n```{{toctree}}\n:hidden:\n\n{names}\n```\n"
    for path in PAGES.iterdir():
        if path.name not in texts:
            path.unlink()
    for name, text in texts.items():
        path = PAGES / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

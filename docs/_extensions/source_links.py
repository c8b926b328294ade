"""Links out of docs/, made for readers of the repository, lead to pages of the site instead.

A link to a module, ``[`spatial_covariance`](../avssl_pyro/acoustics/covariance.py)``, goes to the function of that name
on the module's page; links to notebooks and to Markdown files elsewhere go to their pages.
"""

import os
import re
from pathlib import Path
from typing import Any

from api_pages import packages
from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
# Pages of the site that show, or stand for, what lies outside docs/.
ELSEWHERE = {
    ROOT / "avssl_pyro": "/api/index.rst",
    ROOT / "notebooks": "/notebooks/index.md",
    ROOT / "README.md": "/index.md",
    ROOT / "CHANGELOG.md": "/changelog.md",
    ROOT / "avssl_pyro" / "weights" / "MODEL_CARD.md": "/model-card.md",
}
LINK = re.compile(r"\[(?P<text>[^\]]+)\]\((?P<path>\.\./[^)#\s]+)(?P<fragment>#[^)\s]*)?\)")


def rewrite(markdown: str, folder: Path, modules: dict[Path, str]) -> str:
    """Markdown with its links out of ``folder`` made fit for the site."""

    def target(link: re.Match[str]) -> str:
        path, text = Path(os.path.normpath(folder / link["path"])), link["text"]
        if module := modules.get(path):
            name = text.strip("`")
            whole = name in {module, text}
            return f"{{py:mod}}`{name} <{module}>`" if whole else f"{{py:obj}}`{name} <{module}.{name}>`"
        page = ELSEWHERE.get(path)
        if page is None and path.parent == ROOT / "notebooks":
            page = f"/notebooks/{path.name}"
        elif page is None and path.is_relative_to(DOCS):
            page = f"/{path.relative_to(DOCS).as_posix()}"
        return link[0] if page is None else f"[{text}]({page}{link['fragment'] or ''})"

    return LINK.sub(target, markdown)


def read(app: Sphinx, docname: str, content: list[str]) -> None:
    source = Path(app.env.doc2path(docname))
    if source.suffix in {".md", ".ipynb"}:
        # Notebooks and included pages were written to be read where they are stored.
        folder = ROOT / "notebooks" if source.suffix == ".ipynb" else source.parent
        modules = {module.path: module.name for package in packages() for module in (package, *package.inside)}
        content[0] = rewrite(content[0], folder, modules)


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""Sphinx's configuration of the documentation site; `make docs` builds it.

The source folder is the repository's root, so links between pages, notebooks and README work there and on the site.
"""

import importlib
import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import avssl_pyro  # noqa: E402

project = "avssl-pyro"
author = "the authors of avssl-pyro"
version = release = avssl_pyro.__version__
html_title = f"{project} {version}"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    # Not linkcode, which wants the address of a public repository.
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]
root_doc = "docs/index"
include_patterns = ["docs/**", "notebooks/*.ipynb", "*.md", "avssl_pyro/weights/*.md"]
exclude_patterns = ["docs/_*"]
# From the configuration's folder for pages, from the source folder for autosummary: absolute serves both.
templates_path = [str(ROOT / "docs" / "_templates")]

# References to anything of the package must resolve; the build fetches no index of other libraries.
nitpicky = True
PRIVATE = r"avssl_pyro\..*\.(_\w+|[A-Z]\w*T)"
nitpick_ignore_regex = [("py:.*", r"(?!avssl_pyro\.).*"), ("py:.*", PRIVATE), ("py:.*", r"avssl_pyro\.cli.*")]

# Options begin with two dashes.
smartquotes = False
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"
nb_merge_streams = True

autodoc_default_options = {"members": True, "member-order": "bysource", "special-members": "__call__"}
autodoc_preserve_defaults = True
# What torch says of forward() in general is not about ours.
autodoc_inherit_docstrings = False
autodoc_typehints_format = "short"
napoleon_numpy_docstring = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88

html_theme = "furo"
# MathJax from a package, so that the site needs no network. As an extension that package forbids parallel builds.
MATHJAX = Path(str(importlib.import_module("sphinx-mathjax-offline").__file__)).parent / "static"
mathjax_path = "mathjax/tex-chtml.js"
html_static_path = ["_static", str(MATHJAX)]
html_css_files = ["site.css"]
html_additional_pages = {"index": "start.html"}
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_show_copyright = False
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

API_LINK = re.compile(r"\[`([\w.]+)`\]\((?:\.\./)*((?:avssl_pyro|models|guides)/[\w/]+)\.py\)")


def link_api(markdown: str) -> str:
    """Links of the repository to a module's file, as links to the object or module on its API page."""

    def target(link: re.Match[str]) -> str:
        module = f"avssl_pyro.{link[2].removeprefix('avssl_pyro/').replace('/', '.')}"
        if link[1] == module:
            return f"{{py:mod}}`{module}`"
        return f"{{py:obj}}`{link[1]} <{module}.{link[1]}>`"

    return API_LINK.sub(target, markdown)


def freshest(notebook: Path, executed: Path) -> Path:
    """The executed copy of a notebook, unless the notebook was changed since."""
    return executed if executed.is_file() and executed.stat().st_mtime >= notebook.stat().st_mtime else notebook


def read(app: Sphinx, docname: str, content: list[str]) -> None:
    """Links to API pages in Markdown; results in notebooks that `make notebooks` has executed."""
    source = Path(app.env.doc2path(docname))
    if source.suffix == ".ipynb":
        content[0] = freshest(source, ROOT / "build" / "notebooks" / source.name).read_text(encoding="utf-8")
    elif source.suffix == ".md":
        content[0] = link_api(content[0])


def notebooks_of(app: Sphinx, *_: object) -> list[str]:
    """Notebooks are read at every build, since their results lie outside the source folder."""
    return [name for name in app.env.found_docs if name.startswith("notebooks/")]


def setup(app: Sphinx) -> None:
    app.connect("source-read", read)
    app.connect("env-get-outdated", notebooks_of)

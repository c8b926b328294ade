"""Sphinx's configuration of the documentation site; `make docs` builds it."""

import sys
from pathlib import Path

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS / "_extensions"), str(DOCS.parent)]

import avssl_pyro  # noqa: E402

project = "avssl-pyro"
author = "the authors of avssl-pyro"
version = release = avssl_pyro.__version__
html_title = f"{project} {version}"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "api_pages",
    "api_texts",
    "drawn_math",
    "notebook_pages",
    "source_links",
]
exclude_patterns = ["_extensions", "_static"]

# References to anything of the package must resolve; those to libraries cannot, since the build asks no network.
nitpicky = True
PRIVATE = r"avssl_pyro\..*\.(_\w+|[A-Z]\w*T)"
nitpick_ignore_regex = [("py:.*", r"(?!avssl_pyro\.).*"), ("py:.*", PRIVATE)]

# Options begin with two dashes.
smartquotes = False
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"
nb_merge_streams = True

autodoc_default_options = {
    "members": True,
    "member-order": "bysource",
    "special-members": "__call__",
}
autodoc_preserve_defaults = True
# What torch says of forward() in general is not about ours.
autodoc_inherit_docstrings = False
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "drawn"
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_show_copyright = False
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

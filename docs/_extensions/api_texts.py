"""What autodoc shows of a module, made to read well: docstrings in Google's style, equations linked, types in short."""

import re
from dataclasses import is_dataclass
from typing import Any, get_type_hints

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.ext.napoleon import Config
from sphinx.ext.napoleon.docstring import GoogleDocstring
from sphinx.util.typing import restify

# Eq. (13), Eqs. (5, 6), Eqs. (13)-(16) and, within brackets, Eqs. 13, 14; not those of other papers, named with a year.
EQUATIONS = re.compile(r"(?<!\d{4}, )\bEqs?\. (?:\(\d+(?:, \d+)*\)(?:-\(\d+\))?|\d+(?:, \d+)*)")
ARRAY = re.compile(r"~numpy\.ndarray\[tuple\[~typing\.Any, \.\.\.\], ~numpy\.dtype\[~numpy\.(\w+)\]\]")


def link_equations(line: str) -> str:
    """Makes the numbers of equations links to the page of the method."""

    def linked(reference: re.Match[str]) -> str:
        return re.sub(r"\(?(\d+)\)?", r":eq:`eq-\1`", reference[0])

    return EQUATIONS.sub(linked, line)


def keep_bars(lines: list[str]) -> list[str]:
    """Bars around a number are its magnitude, not reStructuredText's substitution; a drawing is left as it is."""
    if any(line.endswith("::") for line in lines):
        return lines
    pieces = "\n".join(lines).split("``")
    return "``".join(piece.replace("|", r"\|") if i % 2 == 0 else piece for i, piece in enumerate(pieces)).split("\n")


def process_docstring(app: Sphinx, what: str, name: str, item: Any, options: object, lines: list[str]) -> None:
    # Of an attribute napoleon takes whatever stands before a colon for its type.
    kind = "object" if what in {"attribute", "property", "data"} else what
    sections = GoogleDocstring(keep_bars(lines), Config(), app, kind, name, item, options).lines()
    lines[:] = [link_equations(line) for line in sections]
    if what == "class":
        bases = [base for base in item.__bases__ if base.__module__ not in {"builtins", "typing"}]
        lines += [f"Extends {', '.join(restify(base, 'smart') for base in bases)}.", ""] if bases else []


def process_signature(
    _app: Sphinx, _what: str, _name: str, item: object, _options: object, arguments: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Writes arrays as numpy.typing does; a protocol is not called to make one."""
    if getattr(item, "_is_protocol", False):
        return None, None
    short = (text and ARRAY.sub(r"NDArray[\1]", text) for text in (arguments, returned))
    return next(short), next(short)


def strip_annotations(_app: Sphinx, _what: str, _name: str, item: Any, _skip: bool, _options: object) -> None:
    """Leaves of a command's options their types; how they are parsed says nothing to a reader."""
    if isinstance(item, type) and is_dataclass(item) and item.__module__.startswith("avssl_pyro.cli"):
        plain = get_type_hints(item)
        item.__annotations__ = {field: plain[field] for field in item.__annotations__}
        item.__init__.__annotations__ = get_type_hints(item.__init__)


def draw_dashes(_app: Sphinx, doctree: nodes.document) -> None:
    """Between a parameter and what it is Sphinx writes two dashes for smart quotes to join, which are off."""
    for text in list(doctree.findall(nodes.Text)):
        if text == " -- ":
            text.parent.replace(text, nodes.Text(" – "))


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("autodoc-process-docstring", process_docstring)
    app.connect("autodoc-process-signature", process_signature)
    app.connect("autodoc-skip-member", strip_annotations)
    app.connect("doctree-read", draw_dashes)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

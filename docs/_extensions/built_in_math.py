"""Equations as MathML made at build time, which browsers draw without a script or a network.

An equation's own number, ``\\tag{13}``, becomes the target of ``:eq:`eq-13```; GitHub understands the same tag.
"""

import re
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.domains.math import MathDomain
from sphinx.transforms import SphinxTransform
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

logger = logging.getLogger(__name__)

TAG = re.compile(r"\s*\\tag\{(\d+)\}")
# docutils sets what follows an accent below the letter instead of beside it; an empty group keeps them apart.
ACCENT = re.compile(r"(\\(?:bar|hat|tilde|overline)\s*(?:\{[^{}]*(?:\{[^{}]*\}[^{}]*)*\}|\\[a-zA-Z]+|\w))(?=[_^])")


class TaggedEquations(SphinxTransform):
    """Equations with a tag bear that number; the others have none."""

    default_priority = 400

    def apply(self, **_: Any) -> None:
        domain = self.env.domains["math"]
        assert isinstance(domain, MathDomain)
        for node in self.document.findall(nodes.math_block):
            text = node.astext()
            if tag := TAG.search(text):
                label, number = f"eq-{tag[1]}", int(tag[1])
                if label in domain.equations and domain.equations[label][0] != self.env.docname:
                    logger.warning("equation (%d) is in two pages", number, location=node)
                domain.equations[label] = (self.env.docname, number)
                node["number"], node["ids"] = number, [nodes.make_id(f"equation-{label}")]
                node.children = [nodes.Text(TAG.sub("", text))]


def mathml(node: nodes.math | nodes.math_block, *, block: bool) -> str:
    text = ACCENT.sub(r"\1{}", node.astext().strip())
    try:
        return tex2mathml(text, as_block=block)
    except MathError as error:
        logger.warning("this cannot be set as MathML: %s (%s)", text, error, location=node)
        return ""


def visit_inline(translator: HTML5Translator, node: nodes.math) -> None:
    translator.body.append(mathml(node, block=False))
    raise nodes.SkipNode


def visit_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    translator.body.append(translator.starttag(node, "div", CLASS="math"))
    translator.body.append(mathml(node, block=True))
    if node["number"]:
        translator.body.append(f'<span class="eqno">({node["number"]})</span>')
    translator.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_transform(TaggedEquations)
    app.add_html_math_renderer("built_in", inline_renderers=(visit_inline, None), block_renderers=(visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}

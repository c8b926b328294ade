"""Equations drawn as SVG at build time: they look alike in every browser, without a script or a network.

An equation's own number, ``\\tag{13}``, becomes the target of ``:eq:`eq-13```; GitHub understands the same tag.
"""

import re
from typing import Any
from xml.etree import ElementTree

import ziamath
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.domains.math import MathDomain
from sphinx.transforms import SphinxTransform
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

logger = logging.getLogger(__name__)

TAG = re.compile(r"\s*\\tag\{(\d+)\}")
# What the drawing is measured in; the page scales it with the text around it.
SIZE = 100.0


class TaggedEquations(SphinxTransform):
    """Equations with a tag bear that number; the others have none."""

    default_priority = 400

    def apply(self, **_: Any) -> None:
        domain = self.env.domains["math"]
        assert isinstance(domain, MathDomain)
        for node in self.document.findall(nodes.math_block):
            if tag := TAG.search(node.astext()):
                label, number = f"eq-{tag[1]}", int(tag[1])
                if domain.equations.get(label, (self.env.docname,))[0] != self.env.docname:
                    logger.warning("equation (%d) is on two pages", number, location=node)
                domain.equations[label] = (self.env.docname, number)
                node["number"], node["ids"] = number, [nodes.make_id(f"equation-{label}")]


def svg(node: nodes.math | nodes.math_block) -> str:
    """The equation in the size and colour of the text, with its TeX for those who listen to the page."""
    text = TAG.sub("", node.astext()).strip()
    # Of the relations this one alone is drawn without space around it.
    spaced = re.sub(r"\\sim\b", r"\\;\\sim\\;", text)
    inline = isinstance(node, nodes.math)
    try:
        drawing = ziamath.Latex(spaced, size=SIZE, color="currentColor", inline=inline)
    except Exception as error:
        logger.warning("this cannot be drawn: %s (%s)", text, error, location=node)
        return ""
    element = drawing.svgxml()
    width, height = (float(element.attrib.pop(side)) / SIZE for side in ("width", "height"))
    position = f"vertical-align:{drawing.getyofst() / SIZE:.3f}em;" if inline else ""
    element.attrib |= {
        "role": "img",
        "aria-label": text,
        "style": f"width:{width:.3f}em;height:{height:.3f}em;{position}",
    }
    return ElementTree.tostring(element, encoding="unicode")


def visit_inline(translator: HTML5Translator, node: nodes.math) -> None:
    translator.body.append(svg(node))
    raise nodes.SkipNode


def visit_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    translator.body.append(translator.starttag(node, "div", CLASS="math"))
    translator.body.append(f"<span>{svg(node)}</span>")
    if node["number"]:
        translator.body.append(f'<span class="eqno">({node["number"]})</span>')
    translator.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_transform(TaggedEquations)
    app.add_html_math_renderer("drawn", inline_renderers=(visit_inline, None), block_renderers=(visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}

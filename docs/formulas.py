r"""Formulas of the documentation as MathML, made when the site is built: no script, no font, no other host.

``$...$`` within a line, ``$$...$$`` as a paragraph of its own, written in LaTeX.
"""

from __future__ import annotations

import re
from typing import Any
from xml.etree.ElementTree import Element, fromstring

from latex2mathml.converter import convert
from markdown import Markdown
from markdown.blockprocessors import BlockProcessor
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor

_INLINE = r"(?<![\\$\w])\$(?=[^\s$])([^$\n]+?)(?<=[^\s\\])\$(?![\w$])"
_DISPLAY = re.compile(r"^\$\$(.+)\$\$$", flags=re.DOTALL)


class _Inline(InlineProcessor):
    """A formula within a line."""

    def handleMatch(self, m: re.Match[str], data: str) -> tuple[Element, int, int]:  # type: ignore[override]  # noqa: N802 -- the base's name
        """Return the formula and where it stands."""
        del data
        return _formula(m[1], "inline"), m.start(0), m.end(0)


class _Display(BlockProcessor):
    """A formula that is a paragraph of its own."""

    def test(self, parent: Element, block: str) -> bool:
        """Return whether the block is a formula."""
        del parent
        return _DISPLAY.match(block.strip()) is not None

    def run(self, parent: Element, blocks: list[str]) -> None:
        """Put the formula in its place."""
        match = _DISPLAY.match(blocks.pop(0).strip())
        assert match is not None
        line = Element("div", {"class": "formula"})
        line.append(_formula(match[1].strip(), "block"))
        parent.append(line)


class Formulas(Extension):
    """Formulas in LaTeX."""

    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802 -- the base's name
        """Read formulas before emphasis, whose signs they use, and after code, in which there are none."""
        md.inlinePatterns.register(_Inline(_INLINE, md), "formula", 186)
        md.parser.blockprocessors.register(_Display(md.parser), "formulas", 95)


def _formula(latex: str, display: str) -> Element:
    """Return a formula; it keeps its own text away from what reads Markdown."""
    formula = fromstring(convert(latex, display=display))  # noqa: S314 -- our own pages
    for part in formula.iter():
        part.tag = part.tag.partition("}")[2] or part.tag
    return formula


def makeExtension(**settings: Any) -> Formulas:  # noqa: N802 -- the name that Markdown calls
    """Return the extension."""
    return Formulas(**settings)

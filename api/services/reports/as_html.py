"""A report as one HTML file: its style and its figures are in it, and it asks no host for anything."""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING

from api.services.reports.drawing import COLORS, INK, QUIET, RULE
from api.services.reports.model import Figure, Report, Sentence, Table

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup

MEDIA_TYPE = "text/html"
#: Colours of the figures -> those of the page, which are others on dark.
_VARIABLES = {INK: "--ink", QUIET: "--quiet", RULE: "--rule"} | {color: f"--c{i}" for i, color in enumerate(COLORS)}


def write(report: Report) -> bytes:
    """Return the file, UTF-8."""
    return _template().render(report=report).encode()


@cache
def _template() -> Template:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 - only where a report is written

    environment = Environment(
        loader=PackageLoader("api.services.reports", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.tests |= {
        "sentence": lambda part: isinstance(part, Sentence),
        "table": lambda part: isinstance(part, Table),
    }
    environment.filters["inline"] = inline
    return environment.get_template("report.html.j2")


def inline(figure: Figure, number: str) -> Markup:
    """Return the SVG of a figure as a part of the page: as wide as that, in its colours, its ids unlike those of any other."""
    from markupsafe import Markup  # noqa: PLC0415 - as above

    drawn = re.sub(r'\bid="', f'id="f{number}-', figure.svg)
    drawn = re.sub(r'(href="#|url\(#)', rf"\g<1>f{number}-", drawn)
    drawn = re.sub(r'(<svg [^>]*?)\bwidth="[^"]*"', r"\1", drawn, count=1)
    drawn = re.sub(r'(<svg [^>]*?)\bheight="[^"]*"', r"\1", drawn, count=1)
    for color, variable in _VARIABLES.items():
        drawn = drawn.replace(color, f"var({variable})")
    label = Markup('<svg role="img" aria-label="{}" ').format(figure.caption)
    return Markup(drawn.replace("<svg ", label, 1))  # noqa: S704 - drawn by matplotlib: letters are paths, comments are gone

"""Step h: the report, one HTML file without any external part; every number in it is read from the service's replies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from examples.demo.findings import PLACES, Findings
from examples.demo.report import figures, tables
from examples.demo.units import measured, parameter, words

TEMPLATE = "report.html"


def write(findings: Findings, path: Path) -> None:
    """Write the report of what was found."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template(TEMPLATE).render(_context(findings))
    path.write_text(page, encoding="utf-8")


def _context(findings: Findings) -> dict[str, Any]:
    return {
        "f": findings,
        "places": PLACES,
        "measured": measured,
        "parameter": parameter,
        "words": words,
        "headline": tables.headline(findings),
        "fits": tables.fits(findings),
        "estimates": tables.estimates(findings),
        "start": tables.starting_point(findings),
        "influence": tables.influence(findings),
        "influence_words": tables.influence_in_words(findings),
        "searches": tables.searches(findings),
        "agreement": tables.agreement(findings),
        "before_after": tables.before_after(findings),
        "certificates": tables.certificates(findings),
        "definitions": tables.definitions(findings),
        "overlay": figures.overlay(findings),
        "steps": figures.steps(findings),
        "accelerations": figures.accelerations(findings),
        "bode": figures.bode(findings),
        "nyquist": figures.nyquist(findings),
        "maps": [figures.grid_map(findings, law, aim) for law, aim in findings.aims],
        "convergence": figures.convergence(findings),
    }

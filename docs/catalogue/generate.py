"""Write the catalogue's pages from the code; `make catalogue` runs it, a test compares the pages with it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from engine import elements, metrics, signals
from engine.model.parameters import Param
from optimizers import methods

HERE = Path(__file__).parent
NOTE = "<!-- Written by `make catalogue` from the code: edit the code, not this page. -->\n"

DOMAINS = {
    "time": "Of an output's response to a command",
    "path": "Of the frequency response of a path",
    "loop": "Of an open loop",
    "system": "Of the poles of the whole system",
}


def cell(text: object) -> str:
    """Escape what would end a table cell."""
    return str(text).replace("|", "\\|").replace("\n", " ")


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *([cell(entry) for entry in row] for row in rows)]
    return [f"| {' | '.join(line)} |" for line in lines]


def parameter_table(parameters: Sequence[Param]) -> list[str]:
    """Return the table of declared parameters, or one sentence where there are none."""
    if not parameters:
        return ["No parameters."]
    rows = []
    for param in parameters:
        default = "optional" if not param.required else "required" if param.default is None else f"`{param.default}`"
        bounds = [f"{'>' if param.lower_open else '≥'} {param.lower:g}"] if math.isfinite(param.lower) else []
        bounds += [f"≤ {param.upper:g}"] if math.isfinite(param.upper) else []
        bounds += [" ".join(f"`{choice}`" for choice in param.choices)] if param.choices else []
        rows.append((f"`{param.name}`", param.symbol, param.unit, default, ", ".join(bounds), param.doc))
    return table(["parameter", "symbol", "unit", "default", "bounds", "meaning"], rows)


def section(kind: str, entry: Any, parameters: Sequence[Param], body: Sequence[str]) -> list[str]:
    """Return one entry of a page."""
    return [f"## `{kind}`: {entry.title}", "", *body, "", *parameter_table(parameters), ""]


def element_page() -> str:
    """Return the page of elements: equation, ports, parameters, source."""
    lines = ["# Elements", ""]
    for kind, element in elements.catalogue().items():
        values = {param.name: param.default for param in element.parameters} | dict(element.example)
        ports = element.ports(values)
        arrows = f"Ports: {names(ports.inputs)} → {names(ports.outputs)}."
        lines += section(
            kind, element, element.parameters, [f"    {element.equation}", "", arrows, f"Source: {element.source}"]
        )
    return NOTE + "\n".join(lines)


def names(ports: Sequence[str]) -> str:
    """Return port names, or a dash where there are none."""
    return ", ".join(f"`{port}`" for port in ports) or "(none)"


def signal_page() -> str:
    """Return the page of commands."""
    lines = ["# Signals", ""]
    for kind, signal in signals.catalogue().items():
        lines += section(kind, signal, signal.parameters, [signal.equation])
    return NOTE + "\n".join(lines)


def metric_page() -> str:
    """Return the page of metrics: definition, unit, source."""
    lines = ["# Metrics", ""]
    found: Mapping[str, Any] = metrics.catalogue()
    for domain, title in DOMAINS.items():
        rows = [
            (f"`{kind}`", metric.unit, metric.definition, metric.better, metric.source)
            for kind, metric in found.items()
            if metric.domain == domain
        ]
        lines += [f"## {title}", "", *table(["key", "unit", "definition", "better", "source"], rows), ""]
    return NOTE + "\n".join(lines)


def method_page() -> str:
    """Return the page of optimisation methods and their options."""
    lines = ["# Methods", ""]
    for kind, method in methods.catalogue().items():
        lines += section(kind, method, method.options, [method.doc, f"Source: {method.source}"])
    return NOTE + "\n".join(lines)


def pages() -> dict[str, str]:
    """Return file name -> text of every generated page."""
    contents = {
        "elements.md": element_page(),
        "signals.md": signal_page(),
        "metrics.md": metric_page(),
        "methods.md": method_page(),
    }
    index = [f"- [{name.removesuffix('.md').capitalize()}]({name})" for name in contents]
    return {"README.md": NOTE + "\n".join(["# Catalogue", "", *index, ""]), **contents}


if __name__ == "__main__":
    for name, text in pages().items():
        (HERE / name).write_text(text)

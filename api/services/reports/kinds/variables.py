"""Design variables of an optimisation with their starts, their best values and their ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from api.convert.values import si
from api.problems.documents import Problem
from api.services.reports.language import say
from api.services.reports.model import Part, Sentence, table
from api.services.reports.origins import Asked
from api.services.reports.quantities import NOTHING, quantity
from engine.diagram.diagram import Diagram
from engine.model.parameters import ParameterInfo

_NEAR = 1e-3
"""A share of the range within which a value is at its end, as on the pages."""


def chosen_variables(asked: Asked, diagram: Diagram) -> list[Part]:
    """Return the table of the variables, and whether a range decides instead of the goals."""
    given = _given(asked)
    best: Mapping[str, float | None] = asked.result["best"]
    rows, ends = [], []
    for path, value in best.items():
        row, end = _row(path, value, given.get(path, {}), diagram.parameters.get(path))
        rows.append(row)
        if end:
            ends.append(path)
    parts: list[Part] = []
    if ends:
        named = ", ".join(ends[:10]) + (say(" and {count} more", count=len(ends) - 10) if len(ends) > 10 else "")
        said = say("At an end of the range: {names}. There the range decides, not the goals.", names=named)
        parts.append(Sentence(said, "warning"))
    columns = (say("Variable"), say("Start"), say("Best"), say("Lower"), say("Upper"), "", say("Meaning"))
    parts.append(table(columns, rows, numeric=[1, 2, 3, 4], total=len(rows)))
    return parts


def _given(asked: Asked) -> dict[str, Mapping[str, Any]]:
    """Return what was said of each variable: of several structures the chosen one's, where it has its own."""
    listed = asked.request.get("variables") or []
    for one in asked.request.get("alternatives") or []:
        if one.get("name") == asked.result.get("chosen") and one.get("variables"):
            listed = one["variables"]
    return {str(one["parameter"]): one for one in listed}


def _row(
    path: str, value: float | None, given: Mapping[str, Any], info: ParameterInfo | None
) -> tuple[tuple[str, ...], str]:
    unit = "" if info is None else info.unit
    lower, upper = _bound(given, "lower", info), _bound(given, "upper", info)
    free = not (given.get("choices") or given.get("expression"))
    end = end_of(value, lower, upper) if free and value is not None else ""
    mark = {"lower": say("at its lower bound"), "upper": say("at its upper bound")}.get(end, "")
    if given.get("expression"):
        mark = say("tied: {expression}", expression=given["expression"])
    elif given.get("choices"):
        mark = say("one of {count} values", count=len(given["choices"]))
    start = _bound(given, "start", info)
    shown = (quantity(start, unit, 5), quantity(value, unit, 5), quantity(lower, unit), quantity(upper, unit))
    return (
        path,
        *(NOTHING if text in {"∞", "−∞"} else text for text in shown),
        mark,
        "" if info is None else info.doc,
    ), end


def _bound(given: Mapping[str, Any], key: str, info: ParameterInfo | None) -> float | None:
    """Return a bound or the start in SI, that of the parameter where nothing is said; None for a command's where it is not."""
    said = given.get(key)
    if said is not None:
        try:
            return si(said, "" if info is None else info.unit, name=key, place=())
        except Problem:
            return None
    if info is None:
        return None
    return info.value if key == "start" else getattr(info, key)


def end_of(value: float, lower: float | None, upper: float | None) -> str:
    """Return at which end of its range a value lies, "" for neither; the pages ask so, too (optimization/ends.ts).

    >>> end_of(20.0, 0.5, 20.0), end_of(3.0, 0.5, 20.0)
    ('upper', '')
    """
    low = -math.inf if lower is None else lower
    high = math.inf if upper is None else upper
    width = high - low if math.isfinite(high - low) else abs(value)

    def near(end: float) -> bool:
        # Of a range over decades a share of its width would hold the smallest of them.
        room = width if end == 0 or low == 0 else min(width, abs(end))
        return abs(value - end) <= _NEAR * room

    if math.isfinite(low) and (value <= low or near(low)):
        return "lower"
    return "upper" if math.isfinite(high) and (value >= high or near(high)) else ""

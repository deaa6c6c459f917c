"""What magneto-rheological dampers share: coefficients that follow the coil current as polynomials.

c(i) = c_0 + c_1 i + c_2 i² + c_3 i³
"""

from __future__ import annotations

from typing import Any

from engine.elements._base import Values
from engine.model.errors import DiagramError
from engine.model.parameters import Param

MAX_TERMS = 4


def coefficient(name: str, symbol: str, unit: str, default: list[float] | None, doc: str) -> Param:
    """Return a parameter that is a polynomial of the current; ``unit`` is that of its constant term."""
    per = "" if not unit else f" ({unit}, {unit}/A, ...)"
    return Param(
        name=name, symbol=symbol, shape="list", default=default,
        doc=f"{doc}{per}: coefficients of 1, i, i², i³",
    )  # fmt: skip


def check(values: Values, *names: str) -> None:
    """Refuse polynomials without a coefficient, or with more than four."""
    for name in names:
        if not 1 <= len(values[name]) <= MAX_TERMS:
            raise DiagramError(f"{name} must be 1 to {MAX_TERMS} coefficients, got {len(values[name])}", at=(name,))


def at_current(values: Values, name: str, current: Any) -> Any:
    """Return the coefficient ``name`` at a current, by Horner's rule."""
    result = values[name][-1]
    for term in values[name][-2::-1]:
        result = result * current + term
    return result

"""Function: any formula of its inputs.

y = f(u1, ..., un)
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

import numpy as np

from engine.elements._base import Ports, Values
from engine.elements._formulas import CONSTANTS, Formulas, check_constants, check_names, constants, table_sizes
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Pattern, Signals
from engine.model.errors import DiagramError, EngineError
from engine.model.parameters import Param

MAX_INPUTS = 64
_INPUT = re.compile(r"u([1-9]\d?)")


@lru_cache(maxsize=256)
def _read(expression: str, tables: tuple[tuple[str, int], ...]) -> Formulas:
    return Formulas([("", expression)], dict(tables))  # asked for at every instant


class Function(NonlinearElement):
    """A law that has no block of its own: gravity of an arm, a linkage, a power, a friction curve.

    Inputs are u1, u2, ...; there are as many as the highest number in the expression. abs, sign, min, max and atan2 change
    the law where their argument passes 0, a table at each of its points; these instants are found exactly, as those of a saturation.
    """

    kind = "function"
    title = "Function"
    equation = "y = f(u1, ..., un)"
    source = "Definition."
    note = "a function has the slopes of its expression at the operating point"
    parameters = (
        Param(
            name="expression", symbol="f", shape="text",
            doc="formula of u1, u2, ... with + - * / **, sqrt, exp, log, sin, cos, tan, tanh, asin, acos, atan, "
            "atan2, abs, sign, min, max, pi and the tables by name",
        ),
        *CONSTANTS,
    )  # fmt: skip
    example = {"expression": "g*sin(u1) + 0.1*u2*abs(u2)", "constants": ["g"], "values": [9.81]}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse what is no formula, and names that nothing gives."""
        check_constants(values)
        found = cls._formula(values)
        inputs = [f"u{k + 1}" for k in range(cls._inputs(found))] or ["u1"]
        own = [name for name in (*(values["constants"] or ()), *(values["tables"] or ())) if _INPUT.fullmatch(name)]
        check_names(found.names, [*inputs, *own], values, at="expression")
        if not found.formulas[0].uses & set(inputs):
            raise DiagramError(
                f"expression must use an input (u1, u2, ...), got '{values['expression'][:80]}'", at=("expression",)
            )

    @classmethod
    def _formula(cls, values: Values) -> Formulas:
        try:
            return _read(values["expression"], table_sizes(values))
        except EngineError as error:
            raise error.within("expression") from None

    @classmethod
    def _inputs(cls, found: Formulas) -> int:
        numbers = [int(match[1]) for name in found.names if (match := _INPUT.fullmatch(name))]
        if max(numbers, default=0) > MAX_INPUTS:
            raise DiagramError(f"inputs must be at most u{MAX_INPUTS}, got u{max(numbers)}", at=("expression",))
        return max(numbers, default=0)

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the inputs u1 to the highest that the expression uses."""
        return Ports(inputs=tuple(f"u{k + 1}" for k in range(cls._inputs(cls._formula(values)))))

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return the inputs that the expression uses."""
        used = cls._formula(values).formulas[0].uses
        return np.array([[name in used for name in cls.ports(values).inputs]])

    @classmethod
    def _given(cls, m: Moment, values: Values) -> dict[str, Any]:
        return {**constants(values), **{f"u{k + 1}": z for k, z in enumerate(m.z)}}

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return the sides on which the inputs are."""
        return cls._formula(values).mode_of(cls._given(m, values))

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the value of the expression."""
        return [cls._formula(values)(0, cls._given(m, values), mode) + 0.0 * m.z[0]]

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far each argument of abs, sign, min, max or atan2 has passed 0."""
        return cls._formula(values).guards(cls._given(m, values), mode)

    @classmethod
    def across(cls, guard: int, mode: Mode, values: Values) -> Mode | None:
        """Return the other side of an argument of sign or atan2."""
        return mode ^ (1 << guard) if guard in cls._formula(values).jumps else None

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return to the other side of that argument."""
        return Change(mode=mode ^ (1 << guard))

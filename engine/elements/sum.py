"""Sum of signals with signs.

y = ± u1 ± u2 ± ...
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Realization, Values, matrix
from engine.model.errors import DiagramError
from engine.model.parameters import Param

MAX_INPUTS = 64


class Sum(Element):
    """Summing junction; ``+-`` is the comparison of a reference with a measurement."""

    kind = "sum"
    title = "Sum"
    equation = "y = ± in1 ± in2 ± ..."
    source = "Definition."
    parameters = (Param(name="signs", symbol="±", shape="text", doc="one character, + or -, for each input"),)
    example = {"signs": "+-"}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse anything but 1 to 64 signs."""
        signs = values["signs"]
        if not 1 <= len(signs) <= MAX_INPUTS or set(signs) - {"+", "-"}:
            raise DiagramError(f"signs must be 1 to {MAX_INPUTS} characters + or -, got '{signs[:80]}'", at=("signs",))

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return an input for each sign."""
        return Ports(inputs=tuple(f"in{i + 1}" for i in range(len(values["signs"]))))

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return D = [±1 ±1 ...]."""
        return Realization.static(matrix([[1.0 if sign == "+" else -1.0 for sign in values["signs"]]]))

"""A command or disturbance that enters the system.

y = u
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Realization, Values, matrix
from engine.model.parameters import Param


class Input(Element):
    """A signal from outside; inside a subsystem, an input port of the subsystem."""

    kind = "input"
    title = "Input"
    equation = "y = u"
    source = "Definition."
    parameters = (
        Param(
            name="role", symbol="role", default="reference", shape="text", choices=("reference", "disturbance"),
            doc="a reference is what the outputs are compared with; for a disturbance the wanted value is 0. Where none is given, an "
            "input that drives ports for loads only is a disturbance",
        ),
    )  # fmt: skip

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return a single output."""
        return Ports(inputs=())

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return an output without dynamics, which the interconnection drives from outside."""
        return Realization.static(matrix([[]]))

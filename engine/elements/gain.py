"""Constant gain.

y = gain u
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Realization, Values, matrix
from engine.model.parameters import Param


class Gain(Element):
    """Multiplication by a constant."""

    kind = "gain"
    title = "Gain"
    equation = "y = gain · u"
    source = "Definition."
    parameters = (Param(name="gain", symbol="K", doc="output over input"),)
    example = {"gain": 2.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return D = gain."""
        return Realization.static(matrix([[values["gain"]]]))

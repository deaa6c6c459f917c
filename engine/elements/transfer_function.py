"""Quotient of two polynomials in s.

y/u = (b_m s^m + ... + b_0) / (a_n s^n + ... + a_0),   m <= n
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Realization, Values
from engine.elements._canonical import rational
from engine.model.parameters import Param


class TransferFunction(Element):
    """Proper rational transfer function; coefficients may be expressions, highest power of s first."""

    kind = "transfer_function"
    title = "Transfer function"
    equation = "y/u = (b_m s^m + ... + b_0) / (a_n s^n + ... + a_0)"
    source = "T. Kailath, Linear Systems, Prentice-Hall 1980, section 2.1 (controllable canonical form)."
    parameters = (
        Param(name="numerator", symbol="b", shape="list", doc="coefficients, highest power of s first"),
        Param(name="denominator", symbol="a", shape="list", doc="coefficients, highest power of s first"),
    )
    example = {"numerator": [1.0], "denominator": [0.01, 1.0]}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the balanced controllable canonical form."""
        return rational(values["numerator"], values["denominator"])

"""Derivative of a signal, rolled off by a first-order filter.

y/u = gain s / (1 + s/w)
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Reading, Realization, Values, matrix
from engine.model.parameters import Param


class Derivative(Element):
    """Filtered derivative; an unfiltered one is improper and answers a step with an impulse."""

    kind = "derivative"
    title = "Filtered derivative"
    equation = "y/u = gain · s / (1 + s/w)"
    source = "K. J. Åström and T. Hägglund, Advanced PID Control, ISA 2006, section 3.3."
    parameters = (
        Param(name="gain", symbol="K", default=1.0, doc="output for an input that grows by 1 per second"),
        Param(
            name="filter_frequency", symbol="w", unit="rad/s", lower=0.0, lower_open=True, scale="log",
            doc="corner of the filter, up to which the output is the derivative",
        ),
    )  # fmt: skip
    example = {"filter_frequency": 200.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the filtered input as state: y = gain x' = gain w (u - x)."""
        gain, w = values["gain"], values["filter_frequency"]
        slope = gain * w
        return Realization(
            a=matrix([[-w]]), b=matrix([[w]]), c=matrix([[-slope]]), d=matrix([[slope]]),
            reading=Reading(c=matrix([[0.0]]), d=matrix([[0.0]]), k=matrix([[gain]])),
        )  # fmt: skip

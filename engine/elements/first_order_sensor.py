"""Sensor that follows its quantity with a first-order lag.

y/u = gain / (1 + T s)
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Realization, Values, matrix
from engine.model.parameters import Param


class FirstOrderSensor(Element):
    """Pressure, force, temperature or position sensor by its gain and time constant."""

    kind = "first_order_sensor"
    title = "First-order sensor"
    equation = "y/u = gain / (1 + T s)"
    source = "E. O. Doebelin, Measurement Systems, McGraw-Hill 2003, section 3.3."
    parameters = (
        Param(name="gain", symbol="K", default=1.0, doc="static sensitivity: output for an input of 1"),
        Param(
            name="time_constant", symbol="T", unit="s", lower=0.0, lower_open=True, scale="log",
            doc="time after which 63 % of a step are shown",
        ),
    )  # fmt: skip
    example = {"time_constant": 0.001}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the indicated quantity as state, in units of the input."""
        rate = 1.0 / values["time_constant"]
        return Realization(a=matrix([[-rate]]), b=matrix([[rate]]), c=matrix([[values["gain"]]]), d=matrix([[0.0]]))

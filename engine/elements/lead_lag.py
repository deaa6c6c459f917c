"""Lead or lag compensator of first order with its gain at rest.

y/u = gain (1 + s/zero_frequency) / (1 + s/pole_frequency)
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Reading, Realization, Values, matrix
from engine.model.parameters import Param


class LeadLag(Element):
    """A lead where the zero lies below the pole, a lag where it lies above; equal frequencies leave the gain alone.

    The phase is largest, arcsin((r - 1)/(r + 1)) with r = pole_frequency/zero_frequency, at the geometric mean of both.
    """

    kind = "lead_lag"
    title = "Lead-lag compensator"
    equation = "y/u = gain · (1 + s/zero_frequency) / (1 + s/pole_frequency)"
    source = (
        "G. F. Franklin, J. D. Powell, A. Emami-Naeini, Feedback Control of Dynamic Systems, Pearson 2010, section 6.7."
    )
    parameters = (
        Param(name="gain", symbol="K", default=1.0, doc="gain at rest"),
        Param(
            name="zero_frequency", symbol="w_z", unit="rad/s", lower=0.0, lower_open=True, scale="log",
            doc="corner of the numerator",
        ),
        Param(
            name="pole_frequency", symbol="w_p", unit="rad/s", lower=0.0, lower_open=True, scale="log",
            doc="corner of the denominator",
        ),
    )  # fmt: skip
    example = {"zero_frequency": 20.0, "pole_frequency": 200.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the input's lag as state, of the size of the input: y = gain (x + x'/zero_frequency)."""
        gain, zero, pole = values["gain"], values["zero_frequency"], values["pole_frequency"]
        ratio = pole / zero
        return Realization(
            a=matrix([[-pole]]), b=matrix([[pole]]), c=matrix([[gain * (1.0 - ratio)]]), d=matrix([[gain * ratio]]),
            reading=Reading(c=matrix([[gain]]), d=matrix([[0.0]]), k=matrix([[gain / zero]])),
        )  # fmt: skip

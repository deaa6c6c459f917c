"""Power amplifier: a command becomes a voltage or a current, with a gain and a bandwidth.

y/u = gain / (1 + s/w_b)
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Element, Ports, Realization, Values, matrix
from engine.model.parameters import Param


class PowerAmplifier(Element):
    """Voltage amplifier in front of a motor, or current amplifier (its own loop closed) in front of a coil.

    It is an ideal source: what it drives does not act back on it.
    """

    kind = "power_amplifier"
    title = "Power amplifier"
    equation = "y/u = gain / (1 + s/w_b)"
    source = "Definition: a gain that rolls off with first order."
    parameters = (
        Param(
            name="gain", symbol="K",
            doc="static gain: output in V (in A for a current amplifier) for a command of 1",
        ),
        Param(
            name="bandwidth", symbol="w_b", unit="rad/s", default=6000.0, lower=0.0, lower_open=True, scale="log",
            doc="angular frequency where the output is 3 dB below its static value",
        ),
        Param(
            name="output", symbol="y", shape="text", default="voltage", choices=("voltage", "current"),
            doc="what the amplifier controls at its output",
        ),
    )  # fmt: skip
    example = {"gain": 10.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return command and voltage, or command and current."""
        output = values["output"]
        return Ports(inputs=("command",), outputs=(output,), output_units=("V" if output == "voltage" else "A",))

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the output as state."""
        bandwidth = values["bandwidth"]
        return Realization(
            a=matrix([[-bandwidth]]), b=matrix([[bandwidth * values["gain"]]]), c=np.ones((1, 1)), d=np.zeros((1, 1))
        )

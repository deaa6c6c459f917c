"""Proportional or servo valve, linear: command to flow with first- or second-order spool dynamics.

Q/u = flow_gain / (1 + 2 d s/w + s²/w²)   or   flow_gain / (1 + T s)
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Element, Ports, Realization, Values, exclusive, matrix
from engine.errors import DiagramError
from engine.parameters import Param


class ProportionalValve(Element):
    """Valve around its centre, where the flow is proportional to the spool.

    A time constant of 0 is an ideal valve. There the derivative in the time constant does not exist (the response would
    have to be differentiated), so an infinitesimal on it is dropped.
    """

    kind = "proportional_valve"
    title = "Proportional valve"
    equation = "Q/u = flow_gain / (1 + 2 d s/w + s²/w²)  or  flow_gain / (1 + T s)"
    source = "H. E. Merritt, Hydraulic Control Systems, Wiley 1967, chapters 5 and 7."
    parameters = (
        Param(name="flow_gain", symbol="K_q", doc="flow for a command of 1, in m³/s per unit of the command"),
        Param(
            name="natural_frequency", symbol="w", unit="rad/s", required=False, lower=0.0, lower_open=True, scale="log",
            doc="undamped frequency of the spool (second order)",
        ),
        Param(
            name="damping_ratio", symbol="d", unit="1", required=False, lower=0.0,
            doc="damping ratio of the spool (second order)",
        ),
        Param(
            name="time_constant", symbol="T", unit="s", required=False, lower=0.0, scale="log",
            doc="lag of the spool (first order)",
        ),
    )  # fmt: skip
    example = {"flow_gain": 1e-4, "natural_frequency": 300.0, "damping_ratio": 0.8}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse a mixture of the two forms, or none of them."""
        exclusive(given, "natural_frequency", "time_constant")
        exclusive(given, "damping_ratio", "time_constant")
        if "time_constant" not in given:
            for name in ("natural_frequency", "damping_ratio"):
                if name not in given:
                    raise DiagramError(f"{name} must be given where there is no time_constant", at=(name,))

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return command and flow."""
        return Ports(inputs=("command",), outputs=("flow",), output_units=("m**3/s",))

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the spool position as state, in units of the command."""
        gain, lag = values["flow_gain"], values["time_constant"]
        if lag is None:
            w, d = values["natural_frequency"], values["damping_ratio"]
            return Realization(
                a=matrix([[0.0, w], [-w, -2.0 * d * w]]), b=matrix([[0.0], [w]]),
                c=matrix([[gain, 0.0]]), d=np.zeros((1, 1)),
            )  # fmt: skip
        if not np.any(np.real(lag)):
            return Realization.static(matrix([[gain]]))
        ideal = np.where(lag.real == 0, 1.0, 0.0) if isinstance(lag, np.ndarray) else 0.0
        rate = 1.0 / (lag + ideal)
        return Realization(
            a=matrix([[-rate]]), b=matrix([[rate]]), c=matrix([[gain * (1.0 - ideal)]]), d=matrix([[gain * ideal]])
        )

"""Proportional valve, linear: command to flow with first- or second-order spool dynamics.

Q = K_q x - K_c p_L,   x/u = 1 / (1 + 2 d s/w + s²/w²)   or   1 / (1 + T s)
"""

from __future__ import annotations

from engine.elements import _valve
from engine.elements._base import Element, Ports, Realization, Values, absent, exclusive, matrix, plain_zero, vanishing
from engine.model.errors import DiagramError
from engine.model.parameters import Param


class ProportionalValve(Element):
    """Valve around its centre, where the flow is proportional to the spool.

    With a flow-pressure coefficient there is a second input, to which the motor's pressure difference is connected. A time constant of 0 is an ideal valve. There the derivative in the time constant does not exist (the response would
    have to be differentiated), so an infinitesimal on it is dropped.
    """

    kind = "proportional_valve"
    title = "Proportional valve"
    equation = "Q = K_q x - K_c p_L;  x/u = 1 / (1 + 2 d s/w + s²/w²)  or  1 / (1 + T s)"
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
        _valve.FLOW_PRESSURE,
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
        """Return command and flow, with the load pressure where the flow depends on it."""
        return Ports(inputs=_valve.inputs("command", values), outputs=("flow",), output_units=("m**3/s",))

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the spool position as state, in units of the command."""
        gain, lag = values["flow_gain"], values["time_constant"]
        if lag is None:
            return _valve.second_order(
                natural_frequency=values["natural_frequency"],
                damping_ratio=values["damping_ratio"],
                drive=1.0,
                outputs=[gain],
                direct=[_valve.flow(0.0, values)],
            )
        lag = plain_zero(lag)
        if absent(lag):
            return Realization.static(matrix([_valve.flow(gain, values)]))
        # In a batch, a member without a lag takes its flow from the command and lets the state decay unseen.
        ideal = vanishing(lag)
        rate = 1.0 / (lag + ideal)
        direct = _valve.flow(gain * ideal, values)
        return Realization(
            a=matrix([[-rate]]),
            b=matrix([[rate, *[0.0 for _ in direct[1:]]]]),
            c=matrix([[gain * (1.0 - ideal)]]),
            d=matrix([direct]),
        )

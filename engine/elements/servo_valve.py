"""Servo valve by its data sheet: current to flow with a second-order spool.

Q = K_q i_x - K_c p_L,   K_q = (Q_N/i_N) sqrt(p_s/Δp_N),   i_x/i = 1 / (1 + 2 d s/w + s²/w²)
"""

from __future__ import annotations

from engine.elements import _valve
from engine.elements._base import Element, Ports, Realization, Values
from engine.model.parameters import Param


class ServoValve(Element):
    """Valve around its centre, where the whole supply pressure drops over its two edges.

    The flow gain follows from the rated flow, which a data sheet states at a rated current and a rated drop over both edges
    (70 bar is usual). ``opening`` is the spool's share of its travel; the linear model holds while it stays within ±1.
    With a flow-pressure coefficient there is a second input, to which the motor's pressure difference is connected.
    The defaults are typical of a two-stage valve of 40 l/min.
    """

    kind = "servo_valve"
    title = "Servo valve"
    equation = "Q = (Q_N/i_N) sqrt(p_s/Δp_N) i_x - K_c p_L;  i_x/i = 1 / (1 + 2 d s/w + s²/w²)"
    source = (
        "W. J. Thayer, Transfer Functions for Moog Servovalves, Technical Bulletin 103, Moog 1965; "
        "H. E. Merritt, Hydraulic Control Systems, Wiley 1967, chapters 5 and 7."
    )
    parameters = (
        Param(
            name="rated_flow", symbol="Q_N", unit="m**3/s", default=6.5e-4, lower=0.0, lower_open=True, scale="log",
            doc="flow at the rated current and the rated pressure drop",
        ),
        Param(
            name="rated_current", symbol="i_N", unit="A", default=0.04, lower=0.0, lower_open=True, scale="log",
            doc="current that opens the valve fully",
        ),
        Param(
            name="rated_pressure_drop", symbol="Δp_N", unit="Pa", default=7e6, lower=0.0, lower_open=True, scale="log",
            doc="pressure drop over both edges at which the rated flow is stated",
        ),
        Param(
            name="supply_pressure", symbol="p_s", unit="Pa", default=21e6, lower=0.0, lower_open=True, scale="log",
            doc="supply pressure less return pressure",
        ),
        Param(
            name="natural_frequency", symbol="w", unit="rad/s", default=600.0, lower=0.0, lower_open=True, scale="log",
            doc="undamped frequency of the spool: where the data sheet shows a phase of -90 degrees",
        ),
        Param(
            name="damping_ratio", symbol="d", unit="1", default=0.8, lower=0.0,
            doc="damping ratio of the spool",
        ),
        _valve.FLOW_PRESSURE,
    )  # fmt: skip

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return current; flow and opening; with the load pressure where the flow depends on it."""
        return Ports(inputs=_valve.inputs("current", values), outputs=("flow", "opening"), output_units=("m**3/s", "1"))

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the spool's opening as state."""
        full = values["rated_flow"] * (values["supply_pressure"] / values["rated_pressure_drop"]) ** 0.5
        direct = _valve.flow(0.0, values)
        return _valve.second_order(
            natural_frequency=values["natural_frequency"],
            damping_ratio=values["damping_ratio"],
            drive=1.0 / values["rated_current"],
            outputs=[full, 1.0],
            direct=[direct, [0.0 for _ in direct]],
        )

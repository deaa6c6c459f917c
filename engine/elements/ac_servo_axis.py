"""Alternating-current servo axis: a closed current loop in front of inertia, friction and load torque.

i/i* = 1/(1 + s/w_c),   J ω' = K_t i - b ω - M_L,   θ' = ω
ω/i* = K_t w_c / ((s + w_c)(J s + b)),   ω/M_L = -1/(J s + b)
"""

from __future__ import annotations

from engine.elements import _electric_motor
from engine.elements._base import Element, Ports, Realization, Values
from engine.model.parameters import Param


class AcServoAxis(Element):
    """Field-oriented synchronous motor, whose current loop hides the windings and the back EMF.

    ``command`` is the wanted torque-making current; ``load_torque`` is positive where it opposes the rotation.
    The defaults are typical of an axis of 1 kW with a current loop of 500 Hz.
    """

    kind = "ac_servo_axis"
    title = "AC servo axis"
    equation = "i/i* = 1/(1 + s/w_c);  J ω' = K_t i - b ω - M_L;  θ' = ω"
    source = (
        "W. Leonhard, Control of Electrical Drives, Springer 2001 "
        "(field-oriented control; the closed current loop as a lag)."
    )
    parameters = (
        Param(
            name="current_bandwidth", symbol="w_c", unit="rad/s", default=3000.0, lower=0.0, lower_open=True,
            scale="log", doc="bandwidth of the closed current loop: there the current is 3 dB below its command",
        ),
        *_electric_motor.shaft(torque_constant=0.5, inertia=1e-3, viscous_friction=1e-3),
    )  # fmt: skip

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the current's command and load torque; angle, speed, acceleration, current and torque."""
        return _electric_motor.ports("command")

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return angle, speed and current as states."""
        bandwidth = values["current_bandwidth"]
        return _electric_motor.realize(
            rate=[0.0, -bandwidth],
            drive=bandwidth,
            current=[0.0, 1.0],
            direct=0.0,
            torque_constant=values["torque_constant"],
            inertia=values["inertia"],
            viscous_friction=values["viscous_friction"],
        )

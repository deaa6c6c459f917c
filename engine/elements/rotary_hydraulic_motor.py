"""Rotary hydraulic motor driven by a flow of oil, with compressibility, leakage, inertia and viscous friction.

Q = D θ' + a_m Δp + (V/(4 β)) Δp',   J θ'' + b θ' + M_L = D Δp,   a_m = C_i + C_e/2
θ/Q = D / (s [C J s² + (C b + J a_m) s + D² + a_m b]),   θ/M_L = -(C s + a_m) / (s [the same]),   C = V/(4 β)
"""

from __future__ import annotations

from engine.elements import _linear_motor
from engine.elements._base import Element, Ports, Realization, Values
from engine.model.parameters import Param


class RotaryHydraulicMotor(Element):
    """The linear motor turned round: displacement in place of area, inertia in place of mass.

    ``load_torque`` is positive where it opposes the rotation. The defaults are typical of an axial piston motor of
    50 cm³ per turn.
    """

    kind = "rotary_hydraulic_motor"
    title = "Rotary hydraulic motor"
    equation = "Q = D θ' + (C_i + C_e/2) Δp + (V/(4 β)) Δp';  J θ'' + b θ' + M_L = D Δp"
    source = "H. E. Merritt, Hydraulic Control Systems, Wiley 1967, chapter 6 (valve controlled motor)."
    parameters = (
        Param(
            name="displacement", symbol="D", unit="m**3/rad", default=8e-6, lower=0.0, lower_open=True, scale="log",
            doc="volume for a rotation of 1 rad: that of a turn divided by 2π",
        ),
        Param(
            name="volume", symbol="V", unit="m**3", default=2e-4, lower=0.0, lower_open=True, scale="log",
            doc="volume of both sides together, with the lines to the valve",
        ),
        _linear_motor.bulk_modulus(),
        Param(
            name="leakage", symbol="C_i", unit="m**3/(s*Pa)", default=2e-12, lower=0.0, scale="log",
            doc="loss flow between the two sides for a pressure difference of 1 Pa",
        ),
        _linear_motor.external_leakage(),
        Param(
            name="inertia", symbol="J", unit="kg*m**2", default=0.05, lower=0.0, lower_open=True, scale="log",
            doc="moment of inertia, load included",
        ),
        Param(
            name="viscous_friction", symbol="b", unit="N*m*s/rad", default=0.1, lower=0.0, scale="log",
            doc="friction torque for a speed of 1 rad/s",
        ),
    )  # fmt: skip

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return flow and load torque; angle, speed, acceleration and pressure difference."""
        return Ports(
            inputs=("flow", "load_torque"),
            outputs=("angle", "speed", "acceleration", "pressure_difference"),
            output_units=("rad", "rad/s", "rad/s**2", "Pa"),
            loads=("load_torque",),
            input_units=("m**3/s", "N*m"),
        )

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return angle, speed and pressure difference as states."""
        return _linear_motor.realize(
            area=values["displacement"],
            capacitance=values["volume"] / (4.0 * values["bulk_modulus"]),
            leakage=values["leakage"] + values["external_leakage"] / 2.0,
            mass=values["inertia"],
            viscous_friction=values["viscous_friction"],
        )

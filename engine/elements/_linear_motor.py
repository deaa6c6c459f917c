"""Linear motor driven by a flow, with compressibility, leakage, inertia and viscous friction: eq. (1) of the paper.

Q = A z' + a_m Δp + C Δp',   m z'' + b_m z' + F = A Δp
z/Q = A / (s [C m s² + (C b_m + m a_m) s + A² + a_m b_m]),   z/F = -(C s + a_m) / (s [the same])
"""

from __future__ import annotations

from typing import Final

from engine.elements._base import Ports, Realization, matrix
from engine.parameters import Param, Scalar

PORTS: Final = Ports(
    inputs=("flow", "force"),
    outputs=("position", "velocity", "acceleration", "pressure_difference"),
    output_units=("m", "m/s", "m/s**2", "Pa"),
)


def area(default: float) -> Param:
    """Declare the piston area."""
    return Param(
        name="area", symbol="A", unit="m**2", default=default, lower=0.0, lower_open=True, scale="log",
        doc="effective area of the piston",
    )  # fmt: skip


def load(*, leakage: float, mass: float, viscous_friction: float) -> tuple[Param, Param, Param]:
    """Declare leakage, mass and friction."""
    return (
        Param(
            name="leakage", symbol="a_m", unit="m**3/(s*Pa)", default=leakage, lower=0.0, scale="log",
            doc="loss flow between the two rooms for a pressure difference of 1 Pa",
        ),
        Param(
            name="mass", symbol="m", unit="kg", default=mass, lower=0.0, lower_open=True, scale="log",
            doc="moved mass, load included",
        ),
        Param(
            name="viscous_friction", symbol="b_m", unit="N*s/m", default=viscous_friction, lower=0.0, scale="log",
            doc="friction force for a velocity of 1 m/s",
        ),
    )  # fmt: skip


def realize(
    *, area: Scalar, capacitance: Scalar, leakage: Scalar, mass: Scalar, viscous_friction: Scalar
) -> Realization:
    """Return the motor with the states position (m), velocity (m/s) and pressure difference (Pa).

    ``capacitance`` C (m³/Pa) is the flow that is stored for a pressure that rises by 1 Pa/s.
    """
    damping, push, inertia = -viscous_friction / mass, area / mass, 1.0 / mass
    return Realization(
        a=matrix([[0.0, 1.0, 0.0], [0.0, damping, push], [0.0, -area / capacitance, -leakage / capacitance]]),
        b=matrix([[0.0, 0.0], [0.0, -inertia], [1.0 / capacitance, 0.0]]),
        c=matrix([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, damping, push], [0.0, 0.0, 1.0]]),
        d=matrix([[0.0, 0.0], [0.0, 0.0], [0.0, -inertia], [0.0, 0.0]]),
    )

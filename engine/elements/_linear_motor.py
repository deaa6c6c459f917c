"""Linear motor driven by a flow, with compressibility, leakage, inertia and viscous friction: eq. (1) of the paper.

Q = A z' + a_m Δp + C Δp',   m z'' + b_m z' + F = A Δp
z/Q = A / (s [C m s² + (C b_m + m a_m) s + A² + a_m b_m]),   z/F = -(C s + a_m) / (s [the same])
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from engine.elements._base import Ports, Realization, by_rates, matrix
from engine.model.parameters import Param, Scalar

PORTS: Final = Ports(
    inputs=("flow", "force"),
    outputs=("position", "velocity", "acceleration", "pressure_difference"),
    output_units=("m", "m/s", "m/s**2", "Pa"),
    loads=("force",),
    input_units=("m**3/s", "N"),
)


def area(default: float) -> Param:
    """Declare the piston area."""
    return Param(
        name="area", symbol="A", unit="m**2", default=default, lower=0.0, lower_open=True, scale="log",
        doc="effective area of the piston",
    )  # fmt: skip


def bulk_modulus() -> Param:
    """Declare the stiffness of the oil."""
    return Param(
        name="bulk_modulus", symbol="β", unit="Pa", default=1.4e9, lower=0.0, lower_open=True, scale="log",
        doc="effective bulk modulus of the oil with its air and the walls",
    )  # fmt: skip


def external_leakage() -> Param:
    """Declare what each room loses to the tank; with equal rooms half of it adds to the leakage between them."""
    return Param(
        name="external_leakage", symbol="C_e", unit="m**3/(s*Pa)", default=0.0, lower=0.0, scale="log",
        doc="loss flow from each room to the tank for a pressure of 1 Pa in it",
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
    return realize_rooms(
        area=area, mass=mass, viscous_friction=viscous_friction,
        push=[area], fill=[1.0 / capacitance], loss=[[-leakage / capacitance]], pressures=[[1.0]],
    )  # fmt: skip


def realize_rooms(
    *,
    area: Scalar,
    mass: Scalar,
    viscous_friction: Scalar,
    push: Sequence[Scalar],
    fill: Sequence[Scalar],
    loss: Sequence[Sequence[Scalar]],
    pressures: Sequence[Sequence[Scalar]],
) -> Realization:
    """Return the motor with the states position (m), velocity (m/s) and n pressures (Pa).

    Parameters
    ----------
    push : sequence of n scalars
        Force for each pressure, in m².
    fill : sequence of n scalars
        What a flow, less the flow that the piston takes (``area`` times velocity), adds to each pressure's derivative.
    loss : sequence of n rows of n scalars
        What the pressures add to it by leakage, in 1/s.
    pressures : sequence of rows of n scalars
        The pressures that are outputs, as sums of the states.
    """
    inertia = 1.0 / mass
    rest = [0.0 for _ in fill]
    moving = [0.0, -viscous_friction * inertia, *[share * inertia for share in push]]
    c = matrix([[1.0, 0.0, *rest], [0.0, 1.0, *rest], moving, *[[0.0, 0.0, *row] for row in pressures]])
    d = matrix([[0.0, 0.0], [0.0, 0.0], [0.0, -inertia], *[[0.0, 0.0] for _ in pressures]])
    return Realization(
        a=matrix([
            [0.0, 1.0, *rest],
            moving,
            *[[0.0, -area * rate, *row] for rate, row in zip(fill, loss, strict=True)],
        ]),
        b=matrix([[0.0, 0.0], [0.0, -inertia], *[[rate, 0.0] for rate in fill]]),
        c=c, d=d, reading=by_rates(c, d, {2: [0.0, 1.0, *rest]}),
    )  # fmt: skip

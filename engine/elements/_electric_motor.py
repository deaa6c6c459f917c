"""Electric motor on its shaft: a current makes a torque, which moves inertia, viscous friction and a load.

M = K_t i,   θ' = ω,   J ω' = M - b ω - M_L
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from engine.elements._base import Ports, Realization, by_rates, matrix
from engine.model.parameters import Param, Scalar

OUTPUTS: Final = ("angle", "speed", "acceleration", "current", "torque")
UNITS: Final = ("rad", "rad/s", "rad/s**2", "A", "N*m")


def ports(command: str) -> Ports:
    """Return the command and the load torque; the motion, the current and the torque that it makes."""
    return Ports(
        inputs=(command, "load_torque"), outputs=OUTPUTS, output_units=UNITS, loads=("load_torque",),
        input_units=({"voltage": "V", "current": "A"}.get(command), "N*m"),
    )  # fmt: skip


def shaft(*, torque_constant: float, inertia: float, viscous_friction: float) -> tuple[Param, Param, Param]:
    """Declare torque constant, inertia and friction."""
    return (
        Param(
            name="torque_constant", symbol="K_t", unit="N*m/A", default=torque_constant, lower=0.0, lower_open=True,
            scale="log", doc="torque for a current of 1 A",
        ),
        Param(
            name="inertia", symbol="J", unit="kg*m**2", default=inertia, lower=0.0, lower_open=True, scale="log",
            doc="moment of inertia of the rotor, load included where it is rigid",
        ),
        Param(
            name="viscous_friction", symbol="b", unit="N*m*s/rad", default=viscous_friction, lower=0.0, scale="log",
            doc="friction torque for a speed of 1 rad/s",
        ),
    )  # fmt: skip


def realize(
    *,
    rate: Sequence[Scalar] | None,
    drive: Scalar,
    current: Sequence[Scalar],
    direct: Scalar,
    torque_constant: Scalar,
    inertia: Scalar,
    viscous_friction: Scalar,
) -> Realization:
    """Return the motor with the states angle (rad), speed (rad/s) and, where it has one, armature current (A).

    Parameters
    ----------
    rate : sequence of 2 scalars, or None
        What speed and current add to the current's derivative; None where the current follows at once.
    drive : scalar
        What the command adds to it.
    current : sequence of 1 or 2 scalars
        The current as a sum of speed and state.
    direct : scalar
        What the command adds to the current at once.
    """
    speed, *state = current
    push, inverse = torque_constant / inertia, 1.0 / inertia
    damping = push * speed - viscous_friction / inertia
    moving = [0.0, damping, *[push * share for share in state]]
    rows: list[list[Scalar]] = [[0.0, 1.0, *[0.0 for _ in state]], moving]
    inputs: list[list[Scalar]] = [[0.0, 0.0], [push * direct, -inverse]]
    if rate is not None:
        rows.append([0.0, *rate])
        inputs.append([drive, 0.0])
    flowing = [0.0, speed, *state]
    still = [0.0 for _ in state]
    c = matrix([
        [1.0, 0.0, *still],
        [0.0, 1.0, *still],
        moving,
        flowing,
        [torque_constant * share for share in flowing],
    ])  # fmt: skip
    d = matrix([
        [0.0, 0.0], [0.0, 0.0], [push * direct, -inverse], [direct, 0.0], [torque_constant * direct, 0.0],
    ])  # fmt: skip
    return Realization(
        a=matrix(rows),
        b=matrix(inputs),
        c=c,
        d=d,
        reading=by_rates(c, d, {OUTPUTS.index("acceleration"): [0.0, 1.0, *still]}),
    )

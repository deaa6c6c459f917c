"""Valve around its centre: a spool follows the command, its opening makes a flow, the load pressure takes some away.

x/u = 1 / (1 + 2 d s/w + s²/w²),   Q = K_q x - K_c p_L
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from engine.elements._base import Realization, Values, matrix
from engine.model.parameters import Param, Scalar

FLOW_PRESSURE: Final = Param(
    name="flow_pressure_coefficient", symbol="K_c", unit="m**3/(s*Pa)", required=False, lower=0.0, scale="log",
    doc="flow lost for a load pressure of 1 Pa; given, the load pressure is an input",
)  # fmt: skip


def inputs(command: str, values: Values) -> tuple[str, ...]:
    """Return the command, and the load pressure where the flow depends on it."""
    return (command,) if values["flow_pressure_coefficient"] is None else (command, "load_pressure")


def flow(by_command: Scalar, values: Values) -> list[Scalar]:
    """Return what the inputs add to the flow at once."""
    coefficient = values["flow_pressure_coefficient"]
    return [by_command] if coefficient is None else [by_command, -coefficient]


def second_order(
    *, natural_frequency: Scalar, damping_ratio: Scalar, drive: Scalar, outputs: Sequence[Scalar],
    direct: Sequence[Sequence[Scalar]],
) -> Realization:  # fmt: skip
    """Return the spool as x1 = its opening and x2 = x1'/w, both of one size.

    Parameters
    ----------
    drive : scalar
        Opening for a command of 1.
    outputs : sequence of scalars
        Each output over the opening.
    direct : sequence of rows
        What the inputs add to each output at once.
    """
    w = natural_frequency
    idle = [0.0] * len(direct[0][1:])
    return Realization(
        a=matrix([[0.0, w], [-w, -2.0 * damping_ratio * w]]),
        b=matrix([[0.0, *idle], [w * drive, *idle]]),
        c=matrix([[gain, 0.0] for gain in outputs]),
        d=matrix(direct),
    )

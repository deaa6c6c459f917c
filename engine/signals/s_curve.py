"""S-curve: a movement whose jerk is limited, so that its acceleration has no jumps.

    u''' = +j, 0, -j, 0, -j, 0, +j in seven phases; phases that a limit makes superfluous are left out

With T_j the time of a jerk phase and T_a that of the whole acceleration, the limits are met in this order:
max_velocity (T_j = min(max_acceleration/j, sqrt(max_velocity/j)), T_a = T_j + max_velocity/acceleration reached); where
the distance is too short for it, max_acceleration (T_a = (T_j + sqrt(T_j² + 4 distance/max_acceleration)) / 2); where it
is too short for that too, the jerk alone (T_j = (distance / (2 j))^(1/3), T_a = 2 T_j).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from engine.model.parameters import Param
from engine.signals._base import START
from engine.signals._profile import Movement, Profile


@dataclass(frozen=True, slots=True, kw_only=True)
class SCurve(Movement):
    """Fastest movement within a velocity, an acceleration and a jerk."""

    max_velocity: float
    max_acceleration: float
    max_jerk: float
    start: float

    kind = "s_curve"
    title = "S-curve"
    equation = "u⃛ = ±max_jerk or 0 in seven phases, |ü| ≤ max_acceleration, |u̇| ≤ max_velocity; u from 0 to distance"
    source = (
        "L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer 2008, sec. 3.4."
    )
    parameters = (
        Param(name="distance", symbol="h", default=1.0, doc="where the movement ends; it begins at 0"),
        Param(name="max_velocity", symbol="v", lower=0.0, lower_open=True, scale="log", doc="largest velocity, 1/s"),
        Param(
            name="max_acceleration", symbol="a", lower=0.0, lower_open=True, scale="log",
            doc="largest acceleration and deceleration, 1/s²",
        ),
        Param(name="max_jerk", symbol="j", lower=0.0, lower_open=True, scale="log", doc="jerk, 1/s³"),
        START,
    )  # fmt: skip
    example: ClassVar[Mapping[str, Any]] = {
        "distance": 1.0, "max_velocity": 1.0, "max_acceleration": 4.0, "max_jerk": 40.0,
    }  # fmt: skip

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the movement."""
        distance = values["distance"]
        sign = -1.0 if distance.real < 0 else 1.0
        phases = []
        if distance.real:
            limits = (values[key] for key in ("max_velocity", "max_acceleration", "max_jerk"))
            edge, whole, cruise = _times(sign * distance, *limits)
            jerk, flat = sign * values["max_jerk"], whole - 2 * edge
            up = [(edge, jerk), (flat, 0.0), (edge, -jerk)]
            phases = [*up, (cruise, 0.0), *((duration, -value) for duration, value in up)]
        return cls(**values, profile=Profile.of(values["start"], phases, degree=3, distance=distance))


def _times(way: float, velocity: float, acceleration: float, jerk: float) -> tuple[float, float, float]:
    """Return T_j, T_a and the time at constant velocity, s; decisions look at real parts."""
    if velocity.real * jerk.real >= acceleration.real**2:
        edge, whole = acceleration / jerk, acceleration / jerk + velocity / acceleration
    else:
        edge = np.sqrt(velocity / jerk)
        whole = 2 * edge
    cruise = way / velocity - whole
    if cruise.real >= 0:
        return edge, whole, cruise
    edge = acceleration / jerk
    whole = (edge + np.sqrt(edge**2 + 4 * way / acceleration)) / 2
    if whole.real < 2 * edge.real:
        edge = (way / (2 * jerk)) ** (1 / 3)
        whole = 2 * edge
    return edge, whole, 0.0

"""Trapezoid: a movement with constant acceleration, constant velocity, constant deceleration.

    velocity rises to v = min(max_velocity, sqrt(|distance| max_acceleration)) in v / max_acceleration,
    stays there, and falls again; u(t) is the position, 0 before start, distance after the end

A distance too short to reach max_velocity makes the velocity a triangle.
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
class Trapezoid(Movement):
    """Fastest movement within a velocity and an acceleration."""

    max_velocity: float
    max_acceleration: float
    start: float

    kind = "trapezoid"
    title = "Trapezoidal velocity"
    equation = "ü = ±max_acceleration until |u̇| = max_velocity, then 0, then the same in reverse; u from 0 to distance"
    source = (
        "L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer 2008, sec. 3.2."
    )
    parameters = (
        Param(name="distance", symbol="h", default=1.0, doc="where the movement ends; it begins at 0"),
        Param(name="max_velocity", symbol="v", lower=0.0, lower_open=True, scale="log", doc="largest velocity, 1/s"),
        Param(
            name="max_acceleration", symbol="a", lower=0.0, lower_open=True, scale="log",
            doc="acceleration and deceleration, 1/s²",
        ),
        START,
    )  # fmt: skip
    example: ClassVar[Mapping[str, Any]] = {"distance": 1.0, "max_velocity": 1.0, "max_acceleration": 4.0}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the movement."""
        distance, velocity, acceleration = (values[key] for key in ("distance", "max_velocity", "max_acceleration"))
        sign = -1.0 if distance.real < 0 else 1.0
        way = sign * distance
        if way.real * acceleration.real < velocity.real**2:
            velocity = np.sqrt(way * acceleration)
        ramp = velocity / acceleration
        cruise = way / velocity - ramp if way.real > 0 else 0.0
        rate = sign * acceleration
        phases = [(ramp, rate), (cruise, 0.0), (ramp, -rate)] if way.real > 0 else []
        return cls(**values, profile=Profile.of(values["start"], phases, degree=2, distance=distance))

"""A piston between two ends: it moves, or it rests at an end that it is pressed against.

at an end, |v| > v_min: v := -e v;   slower: v = 0 for as long as the net force F presses against the end
"""

from __future__ import annotations

from typing import Any

import numpy as np

from engine.elements._base import Values
from engine.elements._nonlinear import first
from engine.model.parameters import Param

FREE, UPPER, LOWER = 0, 1, 2

STROKE = Param(
    name="stroke", symbol="L", unit="m", default=0.5, lower=0.0, lower_open=True, scale="log",
    doc="way between the two ends",
)  # fmt: skip
RESTITUTION = Param(
    name="restitution", symbol="e", unit="1", default=0.0, lower=0.0, upper=0.95,
    doc="velocity after hitting an end over that before; 0: it stays there",
)  # fmt: skip
POSITION = Param(
    name="initial_position", symbol="x_0", unit="m", required=False, lower=0.0,
    doc="position at the beginning, from the lower end; absent: the middle",
)  # fmt: skip

_SLOW = 1e-4
"""A piston slower than this, in strokes per second, does not rebound any more."""


def start(values: Values) -> Any:
    """Return the position at the beginning."""
    position = values["initial_position"]
    return 0.5 * values["stroke"] if position is None else position


def moves(stop: int, velocity: Any, force: Any, mass: Any) -> tuple[Any, Any]:
    """Return the rates of position and velocity."""
    if stop == FREE:
        return velocity, force / mass
    return 0.0 * force, 0.0 * force


def guards(stop: int, position: Any, force: Any, values: Values) -> list[Any]:
    """Return how far the piston is beyond its ends, or how hard it is pulled away from one."""
    if stop == FREE:
        return [position - values["stroke"], -position]
    return [-force if stop == UPPER else force]


def switch(guard: int, stop: int, velocity: Any, values: Values) -> tuple[int, Any, Any]:
    """Return the new place with position (None: as it was) and velocity."""
    if stop != FREE:
        return FREE, None, 0.0 * velocity
    end = values["stroke"] + 0.0 * velocity if guard == 0 else 0.0 * velocity
    after = -values["restitution"] * velocity
    if abs(first(after)) > _SLOW * first(values["stroke"]) and np.any(values["restitution"]):
        return FREE, end, after
    return (UPPER, LOWER)[guard], end, 0.0 * velocity

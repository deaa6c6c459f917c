"""A point that a convex method has looked at on the exact response."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from optimizers.problem import Vector

FEASIBLE = 1e-7
"""Largest relative violation of a bound, on the continuous frequency axis, that a solution may have."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """Parameter values ``x`` (V,), SI, with the values of all goals (S, G) and what they mean.

    ``frequencies`` are those of the summits in each scenario, rad/s, where a method needs them.
    """

    x: Vector
    goals: Vector
    objective: float
    violation: float
    stable: bool
    frequencies: tuple[Vector, ...] = ()

    @property
    def rank(self) -> tuple[float, float]:
        """First the violation, then the objective."""
        return (self.violation if self.violation > FEASIBLE else 0.0, self.objective)

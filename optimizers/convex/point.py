"""A point that a convex method has looked at on the exact response, and what the objective is around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from optimizers.evaluation.evaluate import Evaluator, Local

if TYPE_CHECKING:
    from collections.abc import Sequence

    from optimizers.problem import Vector

FEASIBLE = 1e-7
"""Largest relative violation of a bound, on the continuous frequency axis, that a solution may have."""


LEAST = 1e-300
"""Stands for 0 where something is divided by it."""


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


def objective_around(evaluator: Evaluator, here: Point, slacks: Sequence[tuple[int, int]]) -> tuple[Vector, Vector]:
    """Return the functions (R,) whose largest is the objective, and their slopes (R, K) by the slacks, relative to its size.

    Parameters
    ----------
    evaluator : Evaluator
    here : Point
    slacks : sequence of (scenario, goal)
        A goal f is f (1 + τ) with its slack τ.
    """
    slopes = np.zeros((*here.goals.shape, len(slacks)))
    for k, (s, g) in enumerate(slacks):
        slopes[s, g, k] = here.goals[s, g]
    size = max(abs(here.objective), LEAST)
    local = Local(values=here.goals, slopes=slopes)
    return evaluator.objectives(here.goals) / size, evaluator.objective_slopes(local) / size


def wanted(evaluator: Evaluator) -> list[tuple[int, int]]:
    """Return the (scenario, goal) of everything that is minimised or approached."""
    problem = evaluator.problem
    goals = sorted({*problem.objectives, *problem.approached})
    return [(s, g) for s in range(len(problem.scenarios)) for g in goals]


def hard_bounds(evaluator: Evaluator) -> dict[int, float]:
    """Return the goals with an upper bound that must hold."""
    goals = evaluator.problem.goals
    return {g: goal.upper for g, goal in enumerate(goals) if goal.hard and goal.upper is not None}

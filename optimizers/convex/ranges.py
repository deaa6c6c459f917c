"""How far each variable can be moved from the start while every variable that is tied to it stays within its own bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from engine.model.errors import EngineError
from optimizers.problem import ProblemError

if TYPE_CHECKING:
    from optimizers.problem import Problem, Scenario, Vector

_SHRINK = 0.25
_MOST_SHRINKS = 20
_SHARES = (0.37, 0.81, 0.23, 0.59, 0.71, 0.13)


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranges:
    """The start ``base`` (V,), one step ``reach`` (V,) for each variable, and a point ``inner`` (V,) where all have moved."""

    base: Vector
    reach: Vector
    inner: Vector


def ranges_of(problem: Problem, scenario: Scenario) -> Ranges:
    """Return steps as long as the bounds allow.

    Raises
    ------
    ProblemError
        If a tied variable is outside its own bounds at the start already.
    """
    axes = problem.axes
    base = np.array([axis.start for axis in axes])
    ends = [axis.upper if axis.upper - axis.start >= axis.start - axis.lower else axis.lower for axis in axes]
    reach = np.array(ends) - base
    if not within(problem, scenario, base):
        names = ", ".join(problem.ties)
        raise ProblemError(
            f"{names} must be within their own bounds at the start, got a value outside", at=("variables",)
        )
    for k in range(len(axes)):
        for _ in range(_MOST_SHRINKS):
            if within(problem, scenario, base + reach * (np.arange(len(axes)) == k)):
                break
            reach[k] *= _SHRINK
    shares = np.array([_SHARES[k % len(_SHARES)] for k in range(len(axes))])
    for _ in range(_MOST_SHRINKS):
        if within(problem, scenario, base + shares * reach):
            break
        shares *= _SHRINK
    return Ranges(base=base, reach=reach, inner=base + shares * reach)


def overrides(problem: Problem, scenario: Scenario, x: Vector) -> dict[str, float]:
    """Return every parameter of a point: the scenario's, the variables and those tied to them."""
    own = {axis.parameter: float(value) for axis, value in zip(problem.axes, x, strict=True)}
    return {**scenario, **own, **problem.tied(own, scenario)}


def limits(problem: Problem) -> list[tuple[str, float, float]]:
    """Return the tied variables with their own bounds."""
    found = []
    for name in problem.ties:
        info = problem.info(name, ())
        found.append((
            name, -math.inf if info.lower is None else info.lower, math.inf if info.upper is None else info.upper
        ))  # fmt: skip
    return found


def within(problem: Problem, scenario: Scenario, x: Vector) -> bool:
    """Return whether every tied variable is within its own bounds, and those of the blocks that follow it."""
    if not problem.ties:
        return True
    values = overrides(problem, scenario, x)
    if not all(low <= values[name] <= high for name, low, high in limits(problem)):
        return False
    try:
        problem.diagram.realize(values)
    except EngineError:
        return False
    return True

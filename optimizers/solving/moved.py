"""What becomes of the goals when one variable moves a little: an optimum that nobody can set is none.

A continuous variable moves by 1 % of its value (of its range where it is 0), a discrete one to the next level; down and up,
as far as its bounds let it. An optimum on the edge of a jump, or one so sharp that 1 % costs a tenth, is told.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.constraint_violation import BROKEN, signed_excess
from optimizers.evaluation.evaluate import UNSTABLE, Assessment, Evaluator
from optimizers.problem import Axis, Goal, Problem, Sense, Vector
from optimizers.search.result import Move, Result

_PART = 0.01
_MUCH = 0.1
"""Loss from which on it is told: of the objective relative to its size, of a goal relative to its bound."""
_MANY = 10.0
"""Loss of the objective from which on no share of it says anything: next to nothing has become something."""


def with_moves(problem: Problem, result: Result, ended: Callable[[], bool]) -> Result:
    """Return the result with what its goals become when each variable moves, and warnings where that is much.

    By fast evaluation. As soon as it has ``ended`` there is the result as it is.
    """
    if result.robustness is not None:
        names = tuple(None for _ in result.robustness.scenarios) if problem.scenario_names else ()
        problem = replace(problem, scenarios=result.robustness.scenarios, scenario_names=names, uncertain=())
    here = np.array([axis.position(result.best[axis.parameter]) for axis in problem.axes])
    evaluator = Evaluator(problem)
    moves: dict[str, dict[str, Move | None]] = {}
    warnings: list[str] = []
    for v, axis in enumerate(problem.axes):
        moves[axis.parameter] = {}
        for side, value in (("down", _next(axis, here[v], -1.0)), ("up", _next(axis, here[v], 1.0))):
            if ended():
                return result
            moves[axis.parameter][side] = move = None if value is None else _move(evaluator, here, v, value)
            if move is not None:
                warnings += _needle(problem, result, axis, move)
    return replace(result, moves=moves, warnings=(*result.warnings, *warnings))


def _next(axis: Axis, position: float, sign: float) -> float | None:
    """Return the value that a variable moves to, None where it cannot."""
    value = float(axis.value(position))
    if axis.discrete:
        levels = sorted(axis.levels)
        index = int(np.argmin(np.abs(np.array(levels) - value))) + int(sign)
        return float(levels[index]) if 0 <= index < len(levels) else None
    step = _PART * (abs(value) or axis.upper - axis.lower)
    there = min(max(value + sign * step, axis.lower), axis.upper)
    return there if abs(there - value) > _PART * step else None


def _move(evaluator: Evaluator, here: Vector, v: int, value: float) -> Move:
    point = here.copy()
    point[v] = evaluator.problem.axes[v].position(value)
    found = evaluator.assess(point[None])
    return Move(
        value=value, values=_worst(evaluator.problem, found), objective=float(found.objective[0]),
        violation=float(found.violation[0]),
    )  # fmt: skip


def _worst(problem: Problem, found: Assessment) -> tuple[float | None, ...]:
    """Return each goal's value in the scenario that serves it worst, None where it has none in some scenario."""

    def of(goal: Goal, values: Vector) -> float | None:
        if np.isnan(values).any():
            return None
        excess = signed_excess(goal, values).max(axis=0, initial=0.0)
        upwards = goal.sense is Sense.MINIMIZE or (goal.sense is None and goal.upper is not None)
        return float(values[np.lexsort((values if upwards else -values, excess))[-1]])

    return tuple(of(goal, found.values[0, :, g]) for g, goal in enumerate(problem.goals))


def _needle(problem: Problem, result: Result, axis: Axis, move: Move) -> list[str]:
    """Return a sentence where a small move costs much."""
    if result.certificate.worst_violation > TOLERANCE:  # what is broken here says nothing about the place
        return []
    moved = f"variable {axis.parameter} at {move.value:.6g} {axis.unit}".rstrip() + (
        f" in the place of {result.best[axis.parameter]:.6g}"
    )
    if move.violation >= UNSTABLE:
        return [f"{moved} is a system that is not stable: the optimum lies at the edge"]
    if move.violation >= BROKEN or math.isnan(move.objective):
        return [f"{moved} leaves a goal without a value: the optimum lies at the edge"]
    if move.violation > _MUCH:
        return [f"{moved} breaks a goal by {move.violation:.2g} of its bound: the optimum needs it set that exactly"]
    size = abs(result.objective)
    loss = (move.objective - result.objective) / size if size > 0 and problem.objectives else 0.0
    if loss > _MUCH:
        told = (
            f"worse by {loss:.0%}" if loss <= _MANY else f"{move.objective:.3g} in the place of {result.objective:.3g}"
        )
        return [f"{moved} makes the objective {told}: the optimum needs it set that exactly"]
    return []

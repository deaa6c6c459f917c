"""The proof of an optimum: every goal in every scenario measured again, twice.

Once by the exact engine, which finds crossings and peaks on the continuous response and the continuous frequency axis, with the
real filters and exact delays; and once by `optimizers.independent_check`, which shares no code with anything that an optimiser evaluates.
The worse of the two counts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from engine.model.interruption import interruptible
from engine.model.verdicts import Measured
from optimizers.evaluation.compared import compared, number_of
from optimizers.evaluation.constraint_violation import BROKEN, signed_excess
from optimizers.evaluation.effort import over
from optimizers.evaluation.measuring import measured as measured_goals
from optimizers.independent_check import CannotFollowError, Statement, witnessed
from optimizers.problem import Goal, Problem, Sense

TOLERANCE = 1e-6
"""Largest violation (relative to the bound; SI where the bound is 0) at which a goal counts as met."""

_ALIKE = 1e-3
"""Two measurements that differ by less than this part of themselves mean the same."""

_EVERY = 8
"""With more scenarios than this the second measurement looks at those that serve some goal worst."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """One goal in the scenario that serves it worst; ``measured.at`` says when (s) or at which frequency (rad/s).

    ``independent`` is the value of the second measurement, None where there is none: a nonlinear system with delays or samplers, or
    without a given duration, a command that does not settle, a metric without a second reading, no time left for it. ``tolerance`` is how far it may
    itself be off, in the metric's unit.
    """

    goal: int
    scenario: int
    measured: Measured
    violation: float
    independent: float | None = None
    tolerance: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """Every goal, exactly; ``valid`` when no violation exceeds 1e-6."""

    valid: bool
    worst_violation: float
    goals: tuple[Proof, ...]


def certify(problem: Problem, variables: Mapping[str, float], rows: list[list[Measured]] | None = None) -> Certificate:
    """Measure every goal in every scenario, twice.

    Parameters
    ----------
    problem : Problem
    variables : mapping of str to float
        Parameter values (SI).
    rows : list of list of Measured, optional
        [scenario][goal] there by the exact engine, where known.

    Returns
    -------
    Certificate
        For each goal, in the order of the problem, the scenario that serves it worst.
    """
    if rows is None:
        rows = [
            [measured for measured, _ in measured_goals(problem, variables, scenario)] for scenario in problem.scenarios
        ]
    first = certificate_of(problem, rows)
    worst = {proof.scenario for proof in first.goals}
    heard = range(len(rows)) if len(rows) <= _EVERY else sorted(worst)
    with interruptible(_look_at_the_time):
        second = {s: witnessed(problem, variables, problem.scenarios[s]) for s in heard}
    return certificate_of(problem, rows, second)


def _look_at_the_time() -> None:
    """End a second measurement that the time does not allow: a point that is proven once is better than none."""
    if over():
        raise CannotFollowError


def certificate_of(
    problem: Problem, rows: list[list[Measured]], second: Mapping[int, Sequence[Statement | None]] | None = None
) -> Certificate:
    """Return the certificate of exact measurements [scenario][goal], and of a second one in some of the scenarios."""
    proofs = []
    for index, goal in enumerate(problem.goals):
        scenario = worst_scenario(goal, [row[index] for row in rows])
        violation = violation_of(goal, rows[scenario][index])
        for other, statements in (second or {}).items():
            statement = statements[index]
            broken = 0.0 if statement is None else _broken(goal, statement)
            if broken > max(violation, TOLERANCE):
                scenario, violation = other, broken
        statement = second[scenario][index] if second and scenario in second else None
        proofs.append(
            Proof(
                goal=index, scenario=scenario, measured=rows[scenario][index], violation=violation,
                independent=None if statement is None else statement.value,
                tolerance=None if statement is None else statement.tolerance,
            )
        )  # fmt: skip
    goals = problem.goals
    counted = (p for p in proofs if goals[p.goal].hard or math.isnan(number_of(goals[p.goal], p.measured)))
    worst = max((proof.violation for proof in counted), default=0.0)
    return Certificate(valid=worst <= TOLERANCE, worst_violation=worst, goals=tuple(proofs))


def violation_of(goal: Goal, measured: Measured) -> float:
    """Return by how much a measured metric breaks the goal, 0 when it does not."""
    return _violation(goal, number_of(goal, measured))


def _violation(goal: Goal, number: float) -> float:
    """Return by how much what a goal compares breaks it, 0 when it does not; infinity counts only where a goal knows it."""
    if math.isnan(number) or (math.isinf(number) and not goal.unlimited):
        return BROKEN
    return float(np.max(signed_excess(goal, np.array(number)).clip(min=0.0), initial=0.0))


def _broken(goal: Goal, statement: Statement) -> float:
    """Return by how much the second measurement breaks the goal, wherever within its tolerance the value is."""
    ends = {statement.value - statement.tolerance, statement.value, statement.value + statement.tolerance}
    return min(_violation(goal, float(compared([goal], np.array([value]))[0])) for value in ends)


def disagreement(proof: Proof) -> str:
    """Return that the two measurements of a goal differ by more than either may be off; an empty string where they agree."""
    value, other = proof.measured.value, proof.independent
    if value is None or other is None or math.isinf(other):
        return ""
    if abs(value - other) <= (proof.tolerance or 0.0) + _ALIKE * max(abs(value), abs(other)):
        return ""
    return f"the two measurements of goal {proof.goal} differ: {value:.6g} and {other:.6g}. The run may depend on its rounding."


def worst_scenario(goal: Goal, measured: list[Measured]) -> int:
    """Return the scenario that serves a goal worst: the largest violation, then the least favourable value."""

    def badness(index: int) -> tuple[float, float]:
        number = number_of(goal, measured[index])
        if math.isnan(number):
            return BROKEN, math.inf
        upwards = goal.sense is Sense.MINIMIZE or (goal.sense is None and goal.upper is not None)
        return _violation(goal, number), number if upwards else -number

    return max(range(len(measured)), key=badness)

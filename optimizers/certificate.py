"""The proof of an optimum: every goal in every scenario re-evaluated by the exact engine.

The exact path finds crossings and peaks on the continuous response and the continuous frequency axis, so a violation
between the samples of whatever the optimiser looked at is seen. Nothing of the optimiser's own evaluation is used.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from engine.verdicts import Measured, Verdict
from optimizers.measuring import measured as measured_goals
from optimizers.problem import Goal, Problem, Sense

TOLERANCE = 1e-6
"""Largest violation (relative to the bound; SI where the bound is 0) at which a goal counts as met."""

BROKEN = 1e2
"""Violation of a goal whose metric has no value, and the largest that an infinite value can have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """One goal in the scenario that serves it worst; ``measured.at`` says when (s) or at which frequency (rad/s)."""

    goal: int
    scenario: int
    measured: Measured
    violation: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """Every goal, exactly; ``valid`` when no violation exceeds 1e-6."""

    valid: bool
    worst_violation: float
    goals: tuple[Proof, ...]


def certify(problem: Problem, variables: Mapping[str, float]) -> Certificate:
    """Re-evaluate every goal in every scenario exactly.

    Parameters
    ----------
    problem : Problem
    variables : mapping of str to float
        Parameter values (SI).

    Returns
    -------
    Certificate
        For each goal, in the order of the problem, the scenario that serves it worst.
    """
    rows = [
        [measured for measured, _ in measured_goals(problem, variables, scenario)] for scenario in problem.scenarios
    ]
    return certificate_of(problem, rows)


def certificate_of(problem: Problem, rows: list[list[Measured]]) -> Certificate:
    """Return the certificate of exact measurements [scenario][goal]."""
    proofs = []
    for index, goal in enumerate(problem.goals):
        scenario = worst_scenario(goal, [row[index] for row in rows])
        measured = rows[scenario][index]
        proofs.append(Proof(goal=index, scenario=scenario, measured=measured, violation=violation_of(goal, measured)))
    worst = max((proof.violation for proof in proofs if problem.goals[proof.goal].hard), default=0.0)
    return Certificate(valid=worst <= TOLERANCE, worst_violation=worst, goals=tuple(proofs))


def number_of(measured: Measured) -> float:
    """Return the value, infinity for a margin or bandwidth that is never crossed, NaN where there is none."""
    if measured.value is not None:
        return measured.value
    return math.inf if measured.verdict is Verdict.NEVER_CROSSES else math.nan


def violation_of(goal: Goal, measured: Measured) -> float:
    """Return by how much a measured metric breaks the goal, 0 when it does not."""
    value = number_of(measured)
    if math.isinf(value) and not goal.unlimited:
        value = math.nan
    return (
        float(np.max(signed_excess(goal, np.array(value)).clip(min=0.0), initial=0.0))
        if not math.isnan(value)
        else BROKEN
    )


def signed_excess(
    goal: Goal, values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return for each bound of the goal (first axis: upper, lower where given) how far values lie beyond it.

    Relative to the bound, plain where the bound is 0; negative where there is room.
    """
    rows = [sign * (values - bound) / (abs(bound) or 1.0) for bound, sign in goal.bounds]
    return np.clip(np.array(rows).reshape(len(rows), *np.shape(values)), -BROKEN, BROKEN)


def worst_scenario(goal: Goal, measured: list[Measured]) -> int:
    """Return the scenario that serves a goal worst: the largest violation, then the least favourable value."""

    def badness(index: int) -> tuple[float, float]:
        value = number_of(measured[index])
        if math.isnan(value):
            return BROKEN, math.inf
        upwards = goal.sense is Sense.MINIMIZE or (goal.sense is None and goal.upper is not None)
        return violation_of(goal, measured[index]), value if upwards else -value

    return max(range(len(measured)), key=badness)

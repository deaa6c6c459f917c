"""From the best point to a result: before and after, what limits it, what moves it, and the proof.

At an optimum the slopes balance (Karush, Kuhn, Tucker); the multipliers are their least-squares solution,

    Σ_r μ_r ∇objective_r + Σ_c λ_c ∇excess_c + bounds = 0,   Σ μ = 1,   μ, λ ≥ 0

so λ tells by how much the objective would change for a change of the bound relative to itself. Where no point serves every
goal, the worst excess takes the place of the objective: the μ of the goals whose slopes balance say who fights whom.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import nnls

from engine.model.verdicts import Measured, Verdict
from optimizers.evaluation.certificate import TOLERANCE, Certificate, disagreement, worst_scenario
from optimizers.evaluation.compared import exactly, number_of
from optimizers.evaluation.constraint_violation import signed_excess
from optimizers.evaluation.effort import Stage, during
from optimizers.evaluation.evaluate import Evaluator, Local, Matrix
from optimizers.problem import Goal, Problem, Vector
from optimizers.search.result import Front, GoalReport, GridMap, Result, Status
from optimizers.search.search import STATIONARY, Tracker

ACTIVE = 1e-3
"""A bound is active when less room than this (relative to the bound) is left."""
_IN_THE_FIGHT = 0.01
"""A goal with less than this share of the multipliers is a bystander."""


def conclude(
    tracker: Tracker,
    position: Vector,
    status: Status,
    advice: str,
    *,
    grid: GridMap | None = None,
    front: Front | None = None,
    bound: float | None = None,
) -> Result:
    """Measure the best point exactly and say everything about it.

    Parameters
    ----------
    tracker : Tracker
    position : ndarray, shape (V,)
        The best point in the unit cube.
    status : Status
        How the search ended; becomes ``infeasible`` when the exact values break a goal.
    advice : str
    grid : GridMap, optional
    front : Front, optional
    bound : float, optional
        An objective that no choice can beat.
    """
    evaluator = tracker.evaluator
    problem = evaluator.problem
    best = problem.values(position)
    names = [axis.parameter for axis in problem.axes]
    with during(Stage.CERTIFICATE):
        found = evaluator.exact.at(best)
        certificate = evaluator.exact.certificate(best)
    rows = [[measured for measured, _ in row] for row in found]
    shown = np.array(
        [[np.full(len(names), np.nan) if gradient is None else gradient.values for _, gradient in row] for row in found]
    )
    values, slopes = exactly(problem.goals, found, len(names))
    by_position = slopes * np.array([axis.slope(best[axis.parameter]) for axis in problem.axes])
    local = Local(values=values, slopes=np.where(np.isfinite(by_position), by_position, 0.0))
    if status is Status.CONVERGED and (tracker.stationarity or 0.0) > STATIONARY:
        status, advice = Status.STALLED, _still_promised(tracker.stationarity)
    multipliers, active = _multipliers(evaluator, position, local)
    goals = []
    for g, goal in enumerate(problem.goals):
        proof = certificate.goals[g]
        before = [row[g] for row in evaluator.exact.before]
        after = rows[proof.scenario][g]
        moves = shown[proof.scenario, g]
        goals.append(
            GoalReport(
                before=before[worst_scenario(goal, before)],
                after=after,
                scenario=proof.scenario,
                met=proof.violation <= TOLERANCE,
                active=bool(active[g]),
                multiplier=float(multipliers[g]) if active[g] else None,
                elasticities={name: _elasticity(after, best[name], float(moves[v])) for v, name in enumerate(names)},
                score=_score(goal, after),
            )
        )
    conflict: dict[int, float] = {}
    if not certificate.valid:
        conflict = _conflict(evaluator, position, local)
        if status in {Status.CONVERGED, Status.STALLED}:
            status, advice = Status.INFEASIBLE, _advice(evaluator, certificate, conflict)
        advice += _unstable_somewhere(problem, rows)
    return Result(
        status=status, advice=advice, best=best, goals=tuple(goals), certificate=certificate,
        history=tuple(tracker.history), evaluations=evaluator.evaluations, seconds=tracker.seconds,
        map=grid, objective=_objective(evaluator, values), conflict=conflict,
        warnings=(*_idle(names, slopes), *filter(None, map(disagreement, certificate.goals))),
        bound=bound, stationarity=tracker.stationarity, front=front, scenario_names=problem.scenario_names,
    )  # fmt: skip


def _still_promised(stationarity: float | None) -> str:
    """Return what to do where the slopes say that the best point is no optimum."""
    return (
        f"the slopes still promise {stationarity:.2g} of the objective for moves of 1 % of the ranges, which no step has found: "
        "raise starts, or begin from this point."
    )


def _objective(evaluator: Evaluator, values: Matrix) -> float:
    return float("nan") if np.isnan(values).any() else float(evaluator.objectives(values).max())


def _score(goal: Goal, after: Measured) -> float | None:
    """Return how a metric stands to its bounds, met at 1; None without a bound or a value."""
    value = number_of(goal, after)
    if not goal.bounded or np.isnan(value):
        return None
    return 1.0 + float(signed_excess(goal, np.array(value)).max())


def _elasticity(after: Measured, parameter: float, slope: float) -> float | None:
    if after.value is None or after.value == 0 or not np.isfinite(slope):
        return None
    return slope * parameter / after.value


def _idle(names: list[str], slopes: Matrix) -> tuple[str, ...]:
    """Return a warning for each variable that moves no goal at all."""
    return tuple(
        f"variable {name} changes no goal: leave it out"
        for v, name in enumerate(names)
        if np.isfinite(slopes[:, :, v]).any() and not np.nan_to_num(slopes[:, :, v]).any()
    )


def _multipliers(evaluator: Evaluator, position: Vector, local: Local) -> tuple[Vector, Vector]:
    """Return the multiplier of each hard goal's bound and which bounds are active, both (G,)."""
    problem = evaluator.problem
    total, active = np.zeros(len(problem.goals)), np.zeros(len(problem.goals), dtype=bool)
    if np.isnan(local.values).any():
        return total, active
    objective = evaluator.objectives(local.values)
    size = max(float(np.abs(objective).max()), 1e-300)
    worst = np.flatnonzero(objective >= objective.max() - ACTIVE * size)
    columns = list(evaluator.objective_slopes(local)[worst] / size)
    owners = [-1] * len(columns)
    for g, column, excess, bound in _excesses(evaluator, local):
        if excess >= -(ACTIVE if bound else TOLERANCE):
            active[g] = True
            columns.append(column)
            owners.append(g)
    for owner, weight in zip(owners, _balance(columns, len(worst), position), strict=True):
        if owner >= 0:
            total[owner] += weight * size
    return total, active


def _excesses(evaluator: Evaluator, local: Local) -> list[tuple[int, Vector, float, float]]:
    """Return (goal, slope of its excess, excess, bound) of every hard bound in every scenario."""
    found = []
    for g, goal in enumerate(evaluator.problem.goals):
        if goal.hard:
            for row, (bound, sign) in zip(signed_excess(goal, local.values[:, g]), goal.bounds, strict=True):
                found += [
                    (g, sign * local.slopes[s, g] / (abs(bound) or 1.0), float(row[s]), bound) for s in range(len(row))
                ]
    return found


def _balance(columns: Sequence[Vector], leading: int, position: Vector) -> Vector:
    """Return weights >= 0 at which slopes balance, those of the first ``leading`` columns adding up to 1; ends may hold."""
    columns = list(columns)
    count = len(columns)
    for v, x in enumerate(position):
        if x <= TOLERANCE or x >= 1 - TOLERANCE:
            unit = np.zeros(len(position))
            unit[v] = -1.0 if x <= TOLERANCE else 1.0
            columns.append(unit)
    matrix = np.array(columns).T
    share = np.array([1.0 if i < leading else 0.0 for i in range(len(columns))])
    heavy = 1e3 * max(float(np.abs(matrix).max()), 1.0)
    solution, _ = nnls(np.vstack([matrix, heavy * share]), np.append(np.zeros(len(position)), heavy))
    return np.asarray(solution[:count])


def _conflict(evaluator: Evaluator, position: Vector, local: Local) -> dict[int, float]:
    """Return the share of each goal in the balance of the worst excesses: those that fight each other."""
    known = [one for one in _excesses(evaluator, local) if np.isfinite(one[2])]
    if not known or np.isnan(local.values).any():
        return {}
    top = max(excess for _, _, excess, _ in known)
    worst = [one for one in known if one[2] >= top - ACTIVE * max(abs(top), 1.0)]
    total: dict[int, float] = {}
    weights = _balance([column for _, column, _, _ in worst], len(worst), position)
    for (g, _, _, _), weight in zip(worst, weights, strict=True):
        total[g] = total.get(g, 0.0) + float(weight)
    return {g: weight for g, weight in total.items() if weight >= _IN_THE_FIGHT}


def _advice(evaluator: Evaluator, certificate: Certificate, conflict: Mapping[int, float]) -> str:
    """Return which goals cannot be met together at the least-violated point."""
    names = [_named(evaluator, g) for g in range(len(certificate.goals))]
    hard = [proof for proof in certificate.goals if evaluator.problem.goals[proof.goal].hard]
    absent = [p for p in certificate.goals if math.isnan(number_of(evaluator.problem.goals[p.goal], p.measured))]
    if absent:
        reasons = (f"{names[p.goal]} has no value ({p.measured.verdict}: {p.measured.advice})" for p in absent)
        return f"{'; '.join(reasons)}. No point with a value of every goal was found: choose another goal, or change its experiment."
    broken = [f"{names[p.goal]} by {p.violation:.3g}" for p in hard if p.violation > TOLERANCE]
    text = f"this is the point that breaks the goals least: {', '.join(broken)} (relative to the bound)"
    if len(conflict) > 1:
        shares = sorted(conflict.items(), key=lambda item: -item[1])
        text += f"; in conflict: {', '.join(f'{names[g]} ({weight:.0%})' for g, weight in shares)}"
    return f"{text}. Relax one of them, widen the bounds of the variables, or allow another structure."


def _unstable_somewhere(problem: Problem, rows: list[list[Measured]]) -> str:
    """Return a sentence about scenarios without a stable system, where there are others."""
    unstable = [s for s, row in enumerate(rows) if any(measured.verdict is Verdict.UNSTABLE for measured in row)]
    if not unstable or len(unstable) == len(rows):
        return ""
    named = ", ".join(problem.scenario_name(s) or str(s) for s in unstable)
    return f" Here the system is unstable in scenario {named} and stable in the others."


def _named(evaluator: Evaluator, index: int) -> str:
    goal = evaluator.problem.goals[index]
    opened = goal.open_at if isinstance(goal.open_at, str) or goal.open_at is None else " and ".join(goal.open_at)
    place = goal.output or opened or goal.target
    return f"{goal.metric} of {place}" if place else goal.metric


def unstable_advice(before: Mapping[str, float]) -> str:
    """Return what to do when no stable point was found."""
    tried = ", ".join(before)
    return f"no stable point was found within the bounds of {tried}: widen them, lower the loop gain, or change the structure."

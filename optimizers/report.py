"""From the best point to a result: before and after, what limits it, what moves it, and the proof.

At an optimum the slopes balance (Karush, Kuhn, Tucker); the multipliers are their least-squares solution,

    Σ_s μ_s ∇f_s + Σ_c λ_c ∇excess_c + bounds = 0,   Σ μ = 1,   μ, λ ≥ 0

so λ tells by how much the objective would change for a change of the bound relative to itself.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.optimize import nnls

from engine.verdicts import Measured
from optimizers.certificate import TOLERANCE, Certificate, certificate_of, number_of, signed_excess, worst_scenario
from optimizers.evaluate import Evaluator, Matrix
from optimizers.problem import Vector
from optimizers.result import GoalReport, GridMap, Result, Status
from optimizers.search import Tracker

ACTIVE = 1e-3
"""A bound is active when less room than this (relative to the bound) is left."""


def conclude(tracker: Tracker, position: Vector, status: Status, advice: str, *, grid: GridMap | None = None) -> Result:
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
    """
    evaluator = tracker.evaluator
    problem = evaluator.problem
    best = problem.values(position)
    names = [axis.parameter for axis in problem.axes]
    found = evaluator.exact(best)
    rows = [[measured for measured, _ in row] for row in found]
    slopes = np.array(
        [[np.full(len(names), np.nan) if gradient is None else gradient.values for _, gradient in row] for row in found]
    )
    certificate = certificate_of(problem, rows)
    values = np.array([[number_of(measured) for measured in row] for row in rows])
    by_position = slopes * np.array([axis.slope(best[axis.parameter]) for axis in problem.axes])
    multipliers, active = _multipliers(evaluator, position, values, by_position)
    goals = []
    for g, goal in enumerate(problem.goals):
        proof = certificate.goals[g]
        before = [row[g] for row in evaluator.before]
        after = proof.measured
        moves = slopes[proof.scenario, g]
        goals.append(
            GoalReport(
                before=before[worst_scenario(goal, before)],
                after=after,
                scenario=proof.scenario,
                met=proof.violation <= TOLERANCE,
                active=bool(active[g]),
                multiplier=float(multipliers[g]) if active[g] else None,
                elasticities={name: _elasticity(after, best[name], float(moves[v])) for v, name in enumerate(names)},
            )
        )
    if not certificate.valid and status in {Status.CONVERGED, Status.STALLED}:
        status, advice = Status.INFEASIBLE, _conflict(evaluator, certificate, active)
    return Result(
        status=status, advice=advice, best=best, goals=tuple(goals), certificate=certificate,
        history=tuple(tracker.history), evaluations=evaluator.evaluations, seconds=tracker.seconds,
        map=grid, warnings=_idle(names, slopes),
    )  # fmt: skip


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


def _multipliers(evaluator: Evaluator, position: Vector, values: Matrix, slopes: Matrix) -> tuple[Vector, Vector]:
    """Return the multiplier of each goal's bound and which bounds are active, both (G,)."""
    problem = evaluator.problem
    total, active = np.zeros(len(problem.goals)), np.zeros(len(problem.goals), dtype=bool)
    if np.isnan(values).any():
        return total, active
    moves = np.where(np.isfinite(slopes), slopes, 0.0)
    objective = evaluator.objectives(values)
    weights = np.array(
        [evaluator.objective_weight(g) if g in problem.objectives else 0.0 for g in range(len(problem.goals))]
    )
    size = max(float(np.abs(objective).max()), 1e-300)
    worst = np.flatnonzero(objective >= objective.max() - ACTIVE * size)
    columns = [np.einsum("g,gv->v", weights, moves[s]) / size for s in worst]
    owners: list[int] = [-1] * len(columns)
    for g, goal in enumerate(problem.goals):
        excess = signed_excess(goal, values[:, g])
        bounds = [(bound, sign) for bound, sign in ((goal.upper, 1.0), (goal.lower, -1.0)) if bound is not None]
        for row, (bound, sign) in zip(excess, bounds, strict=True):
            for s in np.flatnonzero(row >= -(ACTIVE if bound else TOLERANCE)):
                active[g] = True
                columns.append(sign * moves[s, g] / (abs(bound) or 1.0))
                owners.append(g)
    for v, x in enumerate(position):
        if x <= TOLERANCE or x >= 1 - TOLERANCE:
            unit = np.zeros(len(position))
            unit[v] = -1.0 if x <= TOLERANCE else 1.0
            columns.append(unit)
            owners.append(-1)
    matrix = np.array(columns).T
    share = np.array([1.0 if i < len(worst) else 0.0 for i in range(len(columns))])
    heavy = 1e3 * max(float(np.abs(matrix).max()), 1.0)
    solution, _ = nnls(np.vstack([matrix, heavy * share]), np.append(np.zeros(len(position)), heavy))
    for owner, weight in zip(owners, solution, strict=True):
        if owner >= 0:
            total[owner] += weight * size
    return total, active


def _conflict(evaluator: Evaluator, certificate: Certificate, active: Vector) -> str:
    """Return which goals cannot be met together at the least-violated point."""
    names = [_named(evaluator, g) for g in range(len(certificate.goals))]
    broken = [f"{names[p.goal]} by {p.violation:.3g}" for p in certificate.goals if p.violation > TOLERANCE]
    against = [names[p.goal] for p in certificate.goals if active[p.goal] and p.violation <= TOLERANCE]
    text = f"this is the point that breaks the goals least: {', '.join(broken)} (relative to the bound)"
    if len(broken) + len(against) > 1:
        text += f"; in conflict: {', '.join([b.split(' by ')[0] for b in broken] + against)}"
    return f"{text}. Relax one of them, widen the bounds of the variables, or allow another structure."


def _named(evaluator: Evaluator, index: int) -> str:
    goal = evaluator.problem.goals[index]
    place = goal.output or goal.open_at or goal.target
    return f"{goal.metric} of {place}" if place else goal.metric


def unstable_advice(before: Mapping[str, float]) -> str:
    """Return what to do when no stable point was found."""
    tried = ", ".join(before)
    return f"no stable point was found within the bounds of {tried}: widen them, lower the loop gain, or change the structure."

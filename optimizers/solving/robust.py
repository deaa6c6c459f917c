"""Ranges of uncertain parameters: the variables are chosen for their corners and for what an adversary finds inside.

    minimize over p  max over u in the ranges  objective(p, u)   subject to   excess_g(p, u) ≤ 0  for every u

solved as a sequence: optimise for the scenarios known, let an adversary look for a worse one at that optimum, add it, repeat.

References
----------
R. Hettich, K. O. Kortanek, "Semi-infinite programming: theory, methods, and applications", SIAM Review 35 (1993) 380-429
(exchange methods).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import Bounds
from scipy.optimize import minimize as scipy_minimize

from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.constraint_violation import signed_excess
from optimizers.evaluation.evaluate import Assessment, Evaluator, Local, Matrix
from optimizers.problem import Across, Problem, Scenario, Vector
from optimizers.problem.turned import turned
from optimizers.search.blocks import in_blocks
from optimizers.search.result import Monitor, Result, Robustness, Share, Status, Unwatched
from optimizers.search.sampling_plan import sobol_sequence
from optimizers.search.search import Stopped, Tracker

_ROUNDS = 6
_MOST_CORNERS = 16
"""So many corners are scenarios from the start; of more, the adversary picks."""
_LOOKED_AT = 1024
_SAMPLES, _FEW = 128, 16
"""Points inside the ranges that the adversary looks at; fewer where each is a simulation."""
_CLIMBS = 4
_STEPS = 25
_WORSE = 1e-4
"""An objective that is worse by less than this part is not worth another scenario."""


@dataclass(frozen=True, kw_only=True)
class Threat:
    """The least favourable point of the ranges: which scenario it changes, and what becomes of the goals there."""

    scenario: Scenario
    name: str | None
    violation: float
    objective: float
    evaluations: int


def solve_robust(problem: Problem, minimize: Callable[[Problem, Monitor], Result], monitor: Monitor) -> Result:
    """Return the best variables for every point of the ranges.

    Parameters
    ----------
    problem : Problem
        With uncertain parameters.
    minimize : callable
        Solves a problem without them.
    monitor : Monitor
    """
    nominal = {axis.parameter: problem.own_value(axis.parameter) for axis in problem.ranges}
    corners = corners_of(problem) if 2 ** len(problem.ranges) <= _MOST_CORNERS else []
    known = [dict(scenario, **point) for scenario in problem.scenarios for point in [nominal, *corners]]
    names = [name for name in problem.scenario_names for _ in [nominal, *corners]]
    current = replace(problem, scenarios=tuple(known), scenario_names=tuple(names), uncertain=())
    result = minimize(current, Share(monitor, 0.0, 1 / _ROUNDS))
    threat = adversary(problem, result.best, 0, monitor)
    spent, rounds = threat.evaluations, 1
    while rounds < _ROUNDS and _worse(problem, threat, result) and not monitor.cancelled():
        known.append(dict(threat.scenario))
        names += [threat.name] if names else []
        begun = tuple(
            replace(v, start=result.best[v.parameter]) if v.expression is None else v for v in problem.variables
        )
        current = replace(current, scenarios=tuple(known), scenario_names=tuple(names), variables=begun)
        result = minimize(current, Share(monitor, rounds / _ROUNDS, 1 / _ROUNDS))
        threat = adversary(problem, result.best, rounds, monitor)
        spent, rounds = spent + threat.evaluations, rounds + 1
    robustness = Robustness(
        scenarios=tuple(known), worst=dict(threat.scenario), violation=threat.violation, objective=threat.objective,
        rounds=rounds, evaluations=spent,
    )  # fmt: skip
    status, advice = result.status, result.advice
    if status is Status.CONVERGED and monitor.cancelled():
        status, advice = Status.CANCELLED, "cancelled: this is the best point until then."
    elif status is Status.CONVERGED and threat.violation > TOLERANCE:
        status = Status.STALLED
        advice = (
            f"somewhere in the ranges a goal is still broken by {threat.violation:.3g}: "
            "narrow them, or relax the goal that is active there."
        )
    return replace(
        result, status=status, advice=advice, robustness=robustness, evaluations=result.evaluations + spent
    )  # fmt: skip


def corners_of(problem: Problem) -> list[dict[str, float]]:
    """Return every corner of the ranges."""
    names = [axis.parameter for axis in problem.ranges]
    ends = itertools.product(*[(axis.lower, axis.upper) for axis in problem.ranges])
    return [dict(zip(names, corner, strict=True)) for corner in ends]


def adversary(problem: Problem, best: Mapping[str, float], seed: int, monitor: Monitor) -> Threat:
    """Return the least favourable point of the ranges at given variables: corners, a sample, and climbs from the worst.

    Cancelled, it returns the least favourable point until then; violation and objective are NaN where there is none.
    """
    evaluator = Evaluator(turned(problem, best))
    tracker = Tracker(evaluator, _Quiet(monitor), budget=10**9)
    count = len(problem.ranges)
    corners = np.array(list(itertools.islice(itertools.product((0.0, 1.0), repeat=count), _LOOKED_AT)))
    sample = sobol_sequence(count, np.random.default_rng(seed)).random(_FEW if problem.diagram.nonlinear else _SAMPLES)
    points = np.vstack([corners, sample])
    parts: list[Assessment] = []
    tried: list[Vector] = []
    try:
        parts += [found for _, found in in_blocks(tracker, points)]
        violation, objective = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("violation", "objective")
        )
        tried = [points[_worst_first(violation, objective)[0]]]
        if violation.max() <= 1.0:  # beyond, a system is unstable somewhere: no climb makes that clearer
            for climb in _climbs(evaluator, points, np.concatenate([part.values for part in parts])):
                if monitor.cancelled():
                    break
                tried.append(climb())
    except Stopped:
        pass
    if not tried:
        return Threat(
            scenario=problem.scenarios[0], name=problem.scenario_name(0), violation=math.nan, objective=math.nan, evaluations=evaluator.evaluations
        )  # fmt: skip
    finer = evaluator.assess(np.array(tried))
    index = int(_worst_first(finer.violation, finer.objective)[0])
    values = evaluator.problem.values(tried[index])
    scenario = _scenario(problem, finer.values[index])
    point = {axis.parameter: values[axis.parameter] for axis in problem.ranges}
    return Threat(
        scenario={**problem.scenarios[scenario], **point}, name=problem.scenario_name(scenario), violation=float(finer.violation[index]),
        objective=float(finer.objective[index]), evaluations=evaluator.evaluations,
    )  # fmt: skip


class _Quiet(Unwatched):
    """What the adversary's search tells: nothing; it only hears that it shall stop."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor

    def cancelled(self) -> bool:
        """Return whether to stop."""
        return self._monitor.cancelled()


def _worst_first(violation: Vector, objective: Vector) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    excess = np.where(violation <= TOLERANCE, 0.0, violation)
    return np.lexsort((-np.where(np.isnan(objective), np.inf, objective), -excess))


def _scenario(problem: Problem, values: Matrix) -> int:
    """Return which scenario suffers most at a point, from its metric values (S, G)."""
    hard = [(g, goal) for g, goal in enumerate(problem.goals) if goal.hard and goal.bounded]
    worst = [
        max((float(signed_excess(goal, row[g]).max()) for g, goal in hard), default=0.0)
        if not np.isnan(row).any()
        else np.inf
        for row in values
    ]
    return int(np.argmax(worst))


def _climbs(evaluator: Evaluator, points: Matrix, values: Matrix) -> list[Callable[[], Vector]]:
    """Return climbs that raise one excess, or the objective, from where the sample shows it highest."""
    problem = evaluator.problem
    aims: list[tuple[float, Vector, Callable[[Matrix, Matrix], tuple[float, Vector]]]] = []
    for g, goal in enumerate(problem.goals):
        for bound, sign in goal.bounds if goal.hard else ():
            heights = sign * (values[:, :, g] - bound) / (abs(bound) or 1.0)
            b, s = np.unravel_index(int(np.nan_to_num(heights, nan=-np.inf).argmax()), heights.shape)
            aims.append((float(heights[b, s]), points[b], _excess(int(s), g, sign / (abs(bound) or 1.0), bound)))
    aims.sort(key=lambda aim: -aim[0])
    chosen = aims[:_CLIMBS]
    objective = np.nan_to_num(evaluator.objectives(values).max(axis=1), nan=-np.inf)
    chosen.append((0.0, points[int(objective.argmax())], _objective(evaluator)))
    return [partial(_climb, evaluator, start, height) for _, start, height in chosen]


def _excess(scenario: int, goal: int, factor: float, bound: float) -> Callable[[Matrix, Matrix], tuple[float, Vector]]:
    def height(values: Matrix, slopes: Matrix) -> tuple[float, Vector]:
        return factor * float(values[scenario, goal] - bound), factor * slopes[scenario, goal]

    return height


def _objective(evaluator: Evaluator) -> Callable[[Matrix, Matrix], tuple[float, Vector]]:
    def height(values: Matrix, slopes: Matrix) -> tuple[float, Vector]:
        rows = evaluator.objectives(values)
        top = int(np.argmax(rows))
        return float(rows[top]), evaluator.objective_slopes(Local(values=values, slopes=slopes))[top]

    return height


def _climb(evaluator: Evaluator, start: Vector, height: Callable[[Matrix, Matrix], tuple[float, Vector]]) -> Vector:
    """Return the end of a climb within the ranges; its start where there are no slopes."""

    def negative(x: Vector) -> tuple[float, Vector]:
        local = evaluator.local(x)
        if local is None:
            return 1e30, np.zeros(len(x))
        value, slope = height(local.values, local.slopes)
        return -value / size, -slope / size

    first = evaluator.local(start)
    if first is None:
        return start
    size = abs(height(first.values, first.slopes)[0]) or 1.0
    solver: Any = scipy_minimize  # its stubs know no function that returns its slope, too
    box = Bounds(np.zeros(len(start)), np.ones(len(start)))
    outcome = solver(negative, start, jac=True, method="L-BFGS-B", bounds=box, options={"maxfun": _STEPS})
    return np.clip(outcome.x, 0.0, 1.0) if np.isfinite(outcome.x).all() else start


def _worse(problem: Problem, threat: Threat, result: Result) -> bool:
    """Return whether what the adversary found is worse than what the result was chosen for."""
    if threat.violation > max(result.certificate.worst_violation, TOLERANCE) * (1 + _WORSE):
        return True
    if problem.across is Across.MEAN or math.isnan(result.objective) or threat.violation > TOLERANCE:
        return False
    return threat.objective > result.objective + _WORSE * abs(result.objective)

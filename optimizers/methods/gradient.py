"""Gradient: a Sobol sample finds promising places, sequential quadratic programming descends from the best of them.

Between descents the surroundings of the best point are sampled, because response times jump where a turning point
grazes their band, and a descent stops there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, final

import numpy as np
from scipy.stats import qmc

from engine.parameters import Param
from optimizers.certificate import TOLERANCE
from optimizers.evaluate import UNSTABLE, Evaluator, Matrix
from optimizers.methods._base import Method
from optimizers.problem import Problem, Vector
from optimizers.proving import descend_to_proof
from optimizers.report import conclude, unstable_advice
from optimizers.result import Monitor, Result, Status
from optimizers.search import SAFETY, Descent, Stopped, Tracker

_BLOCK = 128
_ROUNDS = 4
_APART = 0.08
_STANDSTILL = 1e-3
_SHORT, _LONG = 25, 60
"""Evaluations of a first descent, and of one from the best point."""


@final
class Gradient(Method):
    """Multi-start sequential quadratic programming with exact derivatives."""

    kind: ClassVar[str] = "gradient"
    title: ClassVar[str] = "Gradient"
    doc: ClassVar[str] = (
        "Samples the ranges, then descends with exact derivatives from the best points; the optimum is proven."
    )
    source: ClassVar[str] = "D. Kraft, A software package for sequential quadratic programming, DFVLR-FB 88-28, 1988"
    options: ClassVar[tuple[Param, ...]] = (
        Param(name="starts", symbol="k", unit="1", doc="points to descend from", default=8, lower=1, upper=100),
        Param(name="seed", symbol="", unit="1", doc="makes the run repeatable", default=0, lower=0, upper=2**32 - 1),
        Param(
            name="max_evaluations",
            symbol="",
            unit="1",
            doc="evaluations of all goals in all scenarios",
            default=5000,
            lower=0,
            upper=1e7,
        ),
    )

    def minimize(
        self, problem: Problem, options: Mapping[str, Any], *, rng: np.random.Generator, monitor: Monitor
    ) -> Result:
        """Return the best point found."""
        tracker = Tracker(Evaluator(problem), monitor, int(options["max_evaluations"]))
        status = Status.CONVERGED
        advice = "descents from different points, and the points around this one, are no better."
        try:
            if not _search(tracker, int(options["starts"]), rng):
                status = Status.STALLED
                advice = "it was still getting better slowly: raise starts, or begin from this point."
        except Stopped as stop:
            status = Status.CANCELLED if stop.cancelled else Status.BUDGET
            advice = (
                "cancelled: this is the best point until then." if stop.cancelled
                else "the budget of evaluations is used up: raise max_evaluations, or fix some of the variables."
            )  # fmt: skip
        best = problem.start() if tracker.best is None else tracker.best
        if tracker.rank[0] >= UNSTABLE and status is Status.CONVERGED:
            status, advice = Status.INFEASIBLE, unstable_advice(problem.before)
        monitor.progress(0.95, "proving the optimum")
        return conclude(tracker, best, status, advice)


def _search(tracker: Tracker, starts: int, rng: np.random.Generator) -> bool:
    """Search; return whether the last round around the best point found nothing better worth mentioning."""
    problem = tracker.evaluator.problem
    margins = np.full(len(problem.goals), SAFETY)
    tracker.monitor.progress(0.0, "sampling")
    points = _sample(tracker, rng)
    chosen = _apart(points, starts)
    descent = Descent(tracker, margins)
    for number, start in enumerate(chosen):
        tracker.monitor.progress(0.2 + 0.4 * number / len(chosen), f"descent {number + 1} of {len(chosen)}")
        descent.run(start, evaluations=_SHORT)
    assert tracker.best is not None
    radius, gain = 0.03, 0.0
    for turn in range(_ROUNDS):
        entered = tracker.rank
        tracker.monitor.progress(0.6 + 0.3 * turn / _ROUNDS, "searching around the best point")
        descent.run(tracker.best, evaluations=_LONG)
        known = tracker.rank
        cloud = np.clip(tracker.best + radius * rng.standard_normal((_BLOCK, len(problem.axes))), 0.0, 1.0)
        tracker.assess(cloud)
        if not tracker.rank < known:
            radius /= 4
        gain = _gain(entered, tracker.rank)
    descend_to_proof(tracker, margins)
    return gain < _STANDSTILL


def _gain(before: tuple[float, float], after: tuple[float, float]) -> float:
    """Return the relative progress from one rank (violation, objective) to the next."""
    number = 0 if before[0] > 0 else 1
    return (before[number] - after[number]) / max(abs(before[number]), 1e-300) if np.isfinite(before[number]) else 0.0


def _sample(tracker: Tracker, rng: np.random.Generator) -> Matrix:
    """Return points from the best to the worst: the start and a Sobol sequence."""
    problem = tracker.evaluator.problem
    count = max(1, min(4 * _BLOCK, tracker.budget // 8))
    sobol = qmc.Sobol(len(problem.axes), rng=rng)
    points = np.vstack([problem.start(), sobol.random_base2(int(np.ceil(np.log2(count))))[: count - 1]])
    ranks = []
    for first in range(0, len(points), _BLOCK):
        tracker.monitor.progress(0.2 * first / len(points), "sampling")
        found = tracker.assess(points[first : first + _BLOCK])
        excess = np.where(found.violation <= TOLERANCE, 0.0, found.violation)
        ranks.append(np.stack([excess, np.nan_to_num(found.objective, nan=np.inf)], axis=1))
    rank = np.concatenate(ranks)
    return points[np.lexsort((rank[:, 1], rank[:, 0]))]


def _apart(points: Matrix, count: int) -> list[Vector]:
    """Return the best points that are not next to a better one."""
    chosen: list[Vector] = []
    for point in points:
        if all(np.abs(point - other).max() > _APART for other in chosen):
            chosen.append(point)
            if len(chosen) == count:
                break
    return chosen

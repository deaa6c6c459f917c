"""Times to settle jump where a later swing leaves the band; beside such an edge the same problem without the jump is searched.

A time of last entry into a band of ±b is smooth as long as the output does not overshoot by more than b, and it jumps where it
begins to. The best point often lies on that edge, where slopes lead across it and neighbours are mostly worse. With

    overshoot ≤ b   for each goal of such a time

as a further bound nothing jumps there, and every point that serves the companion serves the problem.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from optimizers.evaluation.evaluate import Evaluator
from optimizers.problem import Goal, Problem, Sense, Vector
from optimizers.search.result import Quiet
from optimizers.search.search import SAFETY, Descent, Tracker
from optimizers.search.successive_linear_programming import Polish

_BANDS = {"settling_time": 0.02, "response_time": 0.05}
_INSIDE = 1e-5
"""So much of the band is kept free: a bound that is met to a tolerance would lie across the edge."""


def companion_of(problem: Problem) -> Problem | None:
    """Return the problem with the bounds beside its times to settle; None where it has no such goal."""
    bounds = tuple(
        Goal(metric="overshoot", experiment=goal.experiment, output=goal.output, upper=_band(goal) * (1 - _INSIDE))
        for goal in problem.goals
        if goal.metric in _BANDS and (goal.sense is Sense.MINIMIZE or goal.upper is not None)
    )
    return replace(problem, goals=(*problem.goals, *bounds)) if bounds else None


def descend_beside(tracker: Tracker, start: Vector, *, evaluations: int) -> None:
    """Descend in the companion of the tracker's problem, by fast evaluation; the tracker measures and remembers the end.

    Raises
    ------
    Stopped
        When cancelled or out of budget.
    """
    beside = companion_of(tracker.evaluator.problem)
    if beside is None:
        return
    inner = Tracker(Evaluator(beside), Quiet(tracker.monitor), tracker.budget - tracker.evaluator.evaluations)
    margins = np.full(len(beside.goals), SAFETY)
    try:
        Descent(inner, margins).run(start, evaluations=evaluations)
        if inner.best is not None:
            Polish(inner, margins).run(inner.best, evaluations=evaluations)
    finally:
        tracker.evaluator.evaluations += inner.evaluator.evaluations
    if inner.best is not None:
        tracker.local(inner.best)
        if inner.stationarity is not None:
            tracker.prove(inner.best, inner.stationarity)


def _band(goal: Goal) -> float:
    return _BANDS[goal.metric]

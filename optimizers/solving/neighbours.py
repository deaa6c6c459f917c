"""Discrete variables after a search: every neighbouring level is tried, the continuous variables descending from there.

A descent keeps discrete variables where they are (their slope is 0); moving them one level at a time from the best point
until no move helps makes it a local optimum in both.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np

from optimizers.evaluation.evaluate import Evaluator
from optimizers.problem import Problem, Vector
from optimizers.search.proving import polish
from optimizers.search.report import conclude
from optimizers.search.result import Monitor, Result, Status
from optimizers.search.search import SAFETY, Descent, Stopped, Tracker

_FOUND = "another level of the discrete variables serves every goal."
_ALL = 4096
"""So many combinations of nothing but discrete variables are simply all looked at."""
_SHORT = 25
_ROUNDS = 20
_BLOCK = 128


def settle(problem: Problem, result: Result, monitor: Monitor) -> Result:
    """Return the result, or a better one with other levels of the discrete variables."""
    discrete = [v for v, axis in enumerate(problem.axes) if axis.discrete]
    if not discrete or result.status in {Status.CANCELLED, Status.BUDGET}:
        return result
    tracker = Tracker(Evaluator(problem), monitor, budget=10**7)
    begin = np.array([axis.position(result.best[axis.parameter]) for axis in problem.axes])
    try:
        tracker.assess(begin[None])
        before = tracker.rank
        combinations = math.prod(len(problem.axes[v].levels) for v in discrete)
        if len(discrete) == len(problem.axes) and combinations <= _ALL:
            every = np.array(list(itertools.product(*[np.linspace(0, 1, len(axis.levels)) for axis in problem.axes])))
            for first in range(0, len(every), _BLOCK):
                tracker.assess(every[first : first + _BLOCK])
        else:
            _moves(problem, tracker, discrete)
            if tracker.best is not None and len(discrete) < len(problem.axes):
                polish(tracker, np.full(len(problem.goals), SAFETY), evaluations=_SHORT)
    except Stopped:
        return result
    if tracker.best is None or not tracker.rank < before:
        return result
    better = conclude(tracker, tracker.best, result.status, result.advice, grid=result.map, front=result.front)
    if better.status is Status.INFEASIBLE and better.certificate.valid:
        better = replace(better, status=Status.CONVERGED, advice=_FOUND)
    later = (replace(point, evaluation=point.evaluation + result.evaluations) for point in better.history[1:])
    return replace(
        better,
        history=(*result.history, *later),
        evaluations=result.evaluations + better.evaluations,
        seconds=result.seconds + better.seconds,
    )


def _moves(problem: Problem, tracker: Tracker, discrete: list[int]) -> None:
    """Move one discrete variable at a time to a neighbouring level, as long as that helps."""
    margins = np.full(len(problem.goals), SAFETY)
    continuous = len(discrete) < len(problem.axes)
    for _ in range(_ROUNDS):
        assert tracker.best is not None
        before = tracker.rank
        near = _near(problem, tracker.best, discrete)
        tracker.assess(near)
        if continuous:
            for start in near:
                Descent(tracker, margins).run(start, evaluations=_SHORT)
        if not tracker.rank < before:
            return


def _near(problem: Problem, best: Vector, discrete: list[int]) -> Vector:
    points = []
    for v in discrete:
        step = 1.0 / (len(problem.axes[v].levels) - 1)
        for x in (best[v] - step, best[v] + step):
            if -step / 2 < x < 1 + step / 2:
                point = best.copy()
                point[v] = x
                points.append(np.clip(point, 0.0, 1.0))
    return np.array(points)

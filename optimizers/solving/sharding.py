"""Work that is cut into parts for several processes: stretches of a grid, stretches of the draws of a yield.

What comes out does not depend on how it was cut. Whether it is worth cutting is measured: n evaluations take the time of a
few of them, times n.

    parts = ⌈n t / PART⌉   where n t > WORTH
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from optimizers import methods
from optimizers.evaluation.evaluate import Evaluator, Matrix
from optimizers.methods.grid import Design, Grid, design_of, first_look
from optimizers.problem import Problem
from optimizers.problem.turned import turned
from optimizers.search.result import Monitor, share_name
from optimizers.search.search import Stopped, Tracker
from optimizers.solving.expectation import Draws, drawn, draws_of
from optimizers.solving.solve import yield_randomness

WORTH = 10.0
"""s of work below which nothing is cut."""
PART = 5.0
"""s of work of a part: long beside the tenths of a second that its way through the queue takes."""
MOST_PARTS = 200

_FIRST_PROBE, _LARGEST_PROBE = 4, 4096
_PROBED = 0.1
"""s: a probe that takes as long tells how long the rest takes."""

Stretch = tuple[int, int]


def cut_grid(kind: str, problem: Problem, options: Mapping[str, Any]) -> list[Stretch]:
    """Return the stretches of the first look of a grid that are worth a part each; none where it is not worth cutting.

    Raises
    ------
    ProblemError
        Of the grid.
    """
    if kind != Grid.kind or problem.uncertain:
        return []
    design = _design(problem, options)
    return _stretches(Evaluator(problem), len(design), lambda n: design.rows(0, n))


def look_at(problem: Problem, options: Mapping[str, Any], stretch: Stretch, *, monitor: Monitor) -> dict[str, Any]:
    """Return what the first look at a stretch of a grid finds: arrays of ``objective``, ``violation``, ``doubtful``.

    Stopped, it returns what it found until then; points that it did not come to have neither number.
    """
    first, last = stretch
    tracker = Tracker(Evaluator(problem), monitor, budget=10**9)
    found = {name: np.full(last - first, np.nan) for name in ("objective", "violation")}
    doubtful = np.zeros(last - first)
    with suppress(Stopped):
        for rows, block in first_look(tracker, _design(problem, options), first, last):
            here = slice(rows.start - first, rows.stop - first)
            found["objective"][here], found["violation"][here] = block.objective, block.violation
            doubtful[here] = block.doubtful
    return {**found, "doubtful": doubtful, "evaluations": tracker.evaluator.evaluations}


def looked_at(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the state from which `optimizers.solving.solve.solve` goes on when all stretches have been looked at, in order."""
    state: dict[str, Any] = {
        name: np.concatenate([part[name] for part in parts]) for name in ("objective", "violation", "doubtful")
    }
    evaluations = sum(int(part["evaluations"]) for part in parts)
    return {share_name(0.0): {"kind": Grid.kind, **state, "evaluations": evaluations}}


def cut_draws(problem: Problem, best: Mapping[str, float], *, samples: int) -> list[Stretch]:
    """Return the stretches of the draws of a yield that are worth a part each; none where it is not worth cutting."""
    points = np.random.default_rng(0).random((min(samples, _LARGEST_PROBE), len(problem.ranges)))
    return _stretches(Evaluator(turned(problem, best)), samples, lambda n: points[:n])


def draw(
    problem: Problem,
    best: Mapping[str, float],
    options: Mapping[str, Any],
    stretch: Stretch,
    *,
    samples: int,
    monitor: Monitor,
) -> Draws:
    """Return what becomes of a stretch of the draws."""
    points = draws_of(problem, samples=samples, rng=yield_randomness(options))
    return drawn(problem, best, points[slice(*stretch)], monitor=monitor)


def _design(problem: Problem, options: Mapping[str, Any]) -> Design:
    resolved = methods.catalogue()[Grid.kind].resolve(options)
    return design_of(problem, resolved, np.random.default_rng(resolved["seed"]))


def _stretches(evaluator: Evaluator, count: int, points: Callable[[int], Matrix]) -> list[Stretch]:
    work = count * _seconds_each(evaluator, count, points)
    if work <= WORTH:
        return []
    parts = min(math.ceil(work / PART), MOST_PARTS, count)
    ends = [round(count * part / parts) for part in range(parts + 1)]
    return list(itertools.pairwise(ends))


def _seconds_each(evaluator: Evaluator, count: int, points: Callable[[int], Matrix]) -> float:
    """Return how long one of many evaluations takes, from as few as tell it."""
    evaluator.assess(points(1), roughly=True)  # what is made once is no part of the measure
    size = min(_FIRST_PROBE, count)
    while True:
        positions = points(size)
        begun = time.perf_counter()
        evaluator.assess(positions, roughly=True)
        taken = time.perf_counter() - begun
        if taken >= _PROBED or len(positions) < size or size >= min(count, _LARGEST_PROBE):
            return taken / len(positions)
        size = min(4 * size, count, _LARGEST_PROBE)

"""A search that knows no slopes: sample around a point, and take the spread of the best for the next sample (cross-entropy).

    x_k ~ N(m, C),   C = 1/e Σ over the elite of (x - m)(x - m)ᵀ

about the old mean, so that the cloud grows where it moves and narrows where it does not. It follows curved valleys between
kinks and jumps, where a descent stops.

References
----------
R. Y. Rubinstein, D. P. Kroese, "The Cross-Entropy Method", Springer, 2004, chapter 5.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.evaluate import Assessment, Matrix
from optimizers.problem import Vector
from optimizers.search.blocks import in_blocks
from optimizers.search.search import Tracker

_RADIUS = 0.05
_NARROWEST = 1e-8

Ranking = Callable[[Matrix, Assessment], tuple[Vector, Vector]]
"""(positions, what was found) -> (violation, objective), by which points are ranked."""


def by_problem(_: Matrix, found: Assessment) -> tuple[Vector, Vector]:
    """Rank points as the problem does."""
    return found.violation, found.objective


def search_around(
    tracker: Tracker, start: Vector, rng: np.random.Generator, *, rounds: int, size: int, ranking: Ranking = by_problem
) -> Vector:
    """Return the best of ``rounds`` samples of ``size`` points around ``start``, which is counted as the worst.

    Raises
    ------
    Stopped
        When cancelled or out of budget.
    """
    elite = max(2, size // 16 if size >= 128 else size // 8)
    best, rank = start, (np.inf, np.inf)
    mean, spread = start, _RADIUS * np.eye(len(start))
    for turn in range(rounds):
        points = np.clip(mean + rng.standard_normal((size, len(start))) @ spread.T, 0.0, 1.0)
        violation, objective = np.empty(size), np.empty(size)
        for rows, found in in_blocks(tracker, points, roughly=True):
            violation[rows], objective[rows] = ranking(points[rows], found)
        violation = np.where(violation <= TOLERANCE, 0.0, violation)
        objective = np.nan_to_num(objective, nan=np.inf)
        order = np.lexsort((objective, violation))[:elite]
        leader = (float(violation[order[0]]), float(objective[order[0]]))
        if leader < rank:
            best, rank = points[order[0]], leader
        steps = points[order] - mean
        values, axes = np.linalg.eigh(steps.T @ steps / elite)
        spread = axes * np.sqrt(np.maximum(values, _NARROWEST**2))
        mean = points[order].mean(axis=0) if turn % 2 else best
    return best

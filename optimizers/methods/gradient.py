"""Gradient: a Sobol sample finds promising places, sequential quadratic programming descends from there by exact slopes.

Where a metric jumps or is the largest of several peaks a descent stops early. A cloud of points, which learns its shape from
its elite (cross-entropy), knows no slopes and goes on; cuts of exact slopes polish what it finds. With compiled kernels a
candidate costs a thousandth of its slopes: then clouds make the way from each start, and slopes the end of the way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

from engine.model.parameters import Param
from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.evaluate import UNSTABLE, Cost, Evaluator, Matrix
from optimizers.methods._base import MAX_SECONDS, Method
from optimizers.problem import Problem, Vector
from optimizers.search.blocks import in_blocks
from optimizers.search.cross_entropy import search_around
from optimizers.search.proving import descend_to_proof, polish
from optimizers.search.report import conclude, unstable_advice
from optimizers.search.result import Keeper, Monitor, Result, Status, kept_by
from optimizers.search.sampling_plan import sobol_sequence
from optimizers.search.search import SAFETY, Descent, Stopped, Tracker

_APART = 0.08
_SMALLEST_CLOUD = 16


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """How many evaluations go where.

    Attributes
    ----------
    sample : int
        Points of the first look.
    starts : int
        Points that a way begins from.
    cloud, last_cloud : tuple of int
        Rounds and points of the cloud around each start, and around the best point; 0 points: none.
    descent, last_descent, polish : int
        Evaluations with slopes: of a descent from each start, of one from the best point, and of a polish.
    """

    sample: int
    starts: int
    cloud: tuple[int, int] = (0, 0)
    last_cloud: tuple[int, int]
    descent: int = 0
    last_descent: int
    polish: int

    @classmethod
    def of(cls, cost: Cost, variables: int, starts: int) -> _Plan:
        """Return the plan for what a candidate costs: where that is much, few variables need few of them.

        A line takes 16 points, a plane 64; a space of many variables takes what is left of some thousand evaluations.
        """
        if cost is Cost.KERNELS:
            return cls(
                sample=4096, starts=starts, cloud=(8, 128), last_cloud=(16, 512), last_descent=25, polish=40
            )  # fmt: skip
        n, few = variables, min(variables, 4)
        polish = min(40, 12 * n)
        if cost is Cost.BATCHES and n > 1:
            return cls(
                sample=128 << (few - 1), starts=min(starts, n), cloud=(4, 64), last_cloud=(8, 64), last_descent=0, polish=polish
            )  # fmt: skip
        return cls(
            sample=min(512, 4 << 2 * few), starts=min(starts, 2 * n), descent=min(25, 2 + 6 * n),
            last_cloud=(8, 4 << few) if n > 1 else (0, 0), last_descent=min(60, 15 * n), polish=polish,
        )  # fmt: skip


@final
class Gradient(Method):
    """Multi-start sequential quadratic programming with exact derivatives."""

    kind: ClassVar[str] = "gradient"
    title: ClassVar[str] = "Gradient"
    doc: ClassVar[str] = (
        "Samples the ranges, descends with exact derivatives from the best points, searches around the best of all and "
        "polishes it; the optimum is proven."
    )
    source: ClassVar[str] = (
        "D. Kraft, A software package for sequential quadratic programming, DFVLR-FB 88-28, 1988; "
        "R. Y. Rubinstein, D. P. Kroese, The Cross-Entropy Method, Springer, 2004, chapter 5"
    )
    options: ClassVar[tuple[Param, ...]] = (
        Param(name="starts", symbol="k", unit="1", doc="points to descend from", default=8, lower=1, upper=100),
        Param(name="seed", symbol="", unit="1", doc="makes the run repeatable", default=0, lower=0, upper=2**32 - 1),
        Param(
            name="max_evaluations",
            symbol="",
            unit="1",
            doc="evaluations of all goals in all scenarios",
            default=20_000,
            lower=0,
            upper=1e7,
        ),
        MAX_SECONDS,
    )

    def minimize(
        self, problem: Problem, options: Mapping[str, Any], *, rng: np.random.Generator, monitor: Monitor
    ) -> Result:
        """Return the best point found; go on from where a monitor that keeps states says."""
        tracker = Tracker(Evaluator(problem), monitor, int(options["max_evaluations"]))
        status = Status.CONVERGED
        advice = "descents from different points, and the points around this one, are no better."
        try:
            _search(tracker, int(options["starts"]), rng)
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


def _search(tracker: Tracker, starts: int, rng: np.random.Generator) -> None:
    """Search, polish the best point and prove it."""
    margins = np.full(len(tracker.evaluator.problem.goals), SAFETY)
    keeper = tracker.monitor if isinstance(tracker.monitor, Keeper) else None
    # Drawn before anything is known, so that a run that goes on later draws the same.
    for_sample, *clouds = rng.spawn(starts + 2)
    plan = _Plan.of(tracker.evaluator.cost, len(tracker.evaluator.problem.axes), starts)
    kept = kept_by(tracker.monitor, Gradient.kind)
    if kept is None:
        tracker.monitor.progress(0.0, "sampling")
        left = _apart(_sample(tracker, for_sample, plan.sample), plan.starts)
    else:
        left = [np.array(start, dtype=float) for start in kept["left"]]
        tracker.restore(kept)
    descent, count = Descent(tracker, margins), len(left)
    while left:
        begin = 0.2 + 0.4 * (1 - len(left) / count)
        tracker.stage(
            begin, begin + 0.4 / count, f"{len(left)} starts to come", evaluations=plan.descent + math.prod(plan.cloud)
        )
        _surround(tracker, left[0], clouds[len(left)], *plan.cloud)
        descent.run(left[0], evaluations=plan.descent)
        left = left[1:]
        if keeper is not None and tracker.best is not None:
            keeper.keep(
                {"kind": Gradient.kind, "left": [start.tolist() for start in left], **tracker.document()}
            )  # fmt: skip
    assert tracker.best is not None
    around = plan.last_descent + math.prod(plan.last_cloud)
    tracker.stage(0.6, 0.85, "searching around the best point", evaluations=around)
    _surround(tracker, tracker.best, clouds[0], *plan.last_cloud)
    descent.run(tracker.best, evaluations=plan.last_descent)
    tracker.stage(0.85, 0.95, "polishing", evaluations=plan.polish)
    polish(tracker, margins, evaluations=plan.polish)
    descend_to_proof(tracker, margins)


def _sample(tracker: Tracker, rng: np.random.Generator, size: int) -> Matrix:
    """Return points from the best to the worst: the start and a Sobol sequence."""
    problem = tracker.evaluator.problem
    count = max(1, min(size, tracker.budget // (8 if tracker.evaluator.cost is Cost.SIMULATION else 3)))
    sobol = sobol_sequence(len(problem.axes), rng)
    points = np.vstack([problem.start(), sobol.random_base2(math.ceil(math.log2(count)))[: count - 1]])
    violation, objective = np.empty(len(points)), np.empty(len(points))
    for rows, found in in_blocks(tracker, points, roughly=True):
        tracker.monitor.progress(0.2 * rows.stop / len(points), "sampling")
        violation[rows] = np.where(found.violation <= TOLERANCE, 0.0, found.violation)
        objective[rows] = np.nan_to_num(found.objective, nan=np.inf)
    return points[np.lexsort((objective, violation))]


def _apart(points: Matrix, count: int) -> list[Vector]:
    """Return the best points that are not next to a better one."""
    chosen: list[Vector] = []
    for point in points:
        if all(np.abs(point - other).max() > _APART for other in chosen):
            chosen.append(point)
            if len(chosen) == count:
                break
    return chosen


def _surround(tracker: Tracker, start: Vector, rng: np.random.Generator, rounds: int, size: int) -> None:
    """Search around a point without slopes."""
    # Half of what is left: slopes must still be affordable afterwards.
    size = min(size, (tracker.budget - tracker.evaluator.evaluations) // max(1, 2 * rounds))
    if size >= _SMALLEST_CLOUD:
        search_around(tracker, start, rng, rounds=rounds, size=size)

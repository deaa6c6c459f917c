"""Grid: every combination of values of the variables, or an even sample of them; the whole map is kept.

With ``refine`` the cells around the best point are divided again, each time over two cells of the grid before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, final

import numpy as np
from scipy.stats import qmc

from engine.parameters import Param
from optimizers.evaluate import UNSTABLE, Evaluator, Matrix
from optimizers.methods._base import Method
from optimizers.problem import Problem, ProblemError
from optimizers.report import conclude, unstable_advice
from optimizers.result import GridMap, Monitor, Result, Status
from optimizers.search import Stopped, Tracker

MOST_POINTS = 1_000_000
_BLOCK = 128


@final
class Grid(Method):
    """Full factorial grid, Sobol sequence or Latin hypercube, refined around the best point if asked for."""

    kind: ClassVar[str] = "grid"
    title: ClassVar[str] = "Grid"
    doc: ClassVar[str] = (
        "Evaluates every combination, keeps the whole map, and shows where the other methods should go."
    )
    source: ClassVar[str] = "D. C. Montgomery, Design and Analysis of Experiments, 8th ed., chapter 5"
    options: ClassVar[tuple[Param, ...]] = (
        Param(name="points", symbol="n", unit="1", doc="values of each variable; a number, or one for each", default=21, lower=2, upper=MOST_POINTS),
        Param(name="refine", symbol="", unit="1", doc="how often the cells around the best point are divided", default=0, lower=0, upper=10),
        Param(
            name="sampling", symbol="", unit="1", doc="all combinations, or an even sample of them", default="full",
            shape="text", choices=("full", "sobol", "latin_hypercube"),
        ),
        Param(name="samples", symbol="N", unit="1", doc="points of a sample", default=1024, lower=1, upper=MOST_POINTS),
        Param(name="seed", symbol="", unit="1", doc="makes a sample repeatable", default=0, lower=0, upper=2**32 - 1),
    )  # fmt: skip

    def minimize(
        self, problem: Problem, options: Mapping[str, Any], *, rng: np.random.Generator, monitor: Monitor
    ) -> Result:
        """Return the best point of the grid.

        Raises
        ------
        ProblemError
            Too many points, named; or ``points`` for something that is no variable.
        """
        counts = _counts(problem, options["points"])
        full = options["sampling"] == "full"
        total = math.prod(counts) if full else int(options["samples"])
        if total > MOST_POINTS:
            raise ProblemError(
                f"points must make at most {MOST_POINTS} combinations, got {' x '.join(map(str, counts))} = {total}: "
                "take fewer, a sobol sample, or the method gradient",
                at=("method", "points"),
            )
        rounds = 1 + int(options["refine"])
        tracker = Tracker(Evaluator(problem), monitor, 1 + rounds * (total + 1))
        axes = [np.linspace(0.0, 1.0, count) for count in counts]
        positions = _combinations(axes) if full else _sampled(options["sampling"], total, len(problem.axes), rng)
        status, advice = (
            Status.CONVERGED,
            "the best point of the grid; between its points there may be better ones (refine, or gradient).",
        )
        objective, violation = np.full(total, np.nan), np.full(total, np.nan)
        try:
            _evaluate(tracker, positions, objective, violation, 0.9 / rounds)
            width = 1.0 / (np.array(counts) - 1) if full else np.full(len(counts), total ** (-1.0 / len(counts)))
            for _ in range(rounds - 1):
                assert tracker.best is not None
                finer = [
                    np.clip(np.linspace(x - w, x + w, n), 0.0, 1.0)
                    for x, w, n in zip(tracker.best, width, counts, strict=True)
                ]
                nearby = _combinations(finer)
                _evaluate(tracker, nearby, np.empty(len(nearby)), np.empty(len(nearby)), 0.9 / rounds)
                width = 2 * width / (np.array(counts) - 1)
        except Stopped:
            status, advice = Status.CANCELLED, "cancelled: this is the best point until then; the map is incomplete."
        if tracker.rank[0] >= UNSTABLE and status is Status.CONVERGED:
            status, advice = Status.INFEASIBLE, unstable_advice(problem.before)
        shape = tuple(counts) if full else (total,)
        coordinates = axes if full else list(positions.T)
        grid = GridMap(
            axes={axis.parameter: axis.value(x) for axis, x in zip(problem.axes, coordinates, strict=True)},
            objective=objective.reshape(shape),
            violation=violation.reshape(shape),
        )
        monitor.progress(0.95, "proving the optimum")
        best = problem.start() if tracker.best is None else tracker.best
        return conclude(tracker, best, status, advice, grid=grid)


def _counts(problem: Problem, points: int | Mapping[str, int]) -> list[int]:
    names = [axis.parameter for axis in problem.axes]
    if not isinstance(points, Mapping):
        return [points] * len(names)
    for name in points:
        if name not in names:
            raise ProblemError(
                f"points must name variables ({', '.join(names)}), got {name!r}", at=("method", "points", name)
            )
    for name in names:
        if name not in points:
            raise ProblemError(f"points must be given for {name}, got nothing", at=("method", "points"))
    return [int(points[name]) for name in names]


def _combinations(axes: list[Matrix]) -> Matrix:
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def _sampled(sampling: str, total: int, dimensions: int, rng: np.random.Generator) -> Matrix:
    if sampling == "sobol":
        return np.asarray(qmc.Sobol(dimensions, rng=rng).random_base2(math.ceil(math.log2(total)))[:total])
    return np.asarray(qmc.LatinHypercube(dimensions, rng=rng).random(total))


def _evaluate(tracker: Tracker, positions: Matrix, objective: Matrix, violation: Matrix, share: float) -> None:
    """Evaluate block by block, so that a cancel is heard."""
    total = len(positions)
    for first in range(0, total, _BLOCK):
        tracker.monitor.progress(share * first / total, f"{first} of {total} points")
        found = tracker.assess(positions[first : first + _BLOCK])
        objective[first : first + _BLOCK] = found.objective
        violation[first : first + _BLOCK] = found.violation

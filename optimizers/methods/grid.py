"""Grid: every combination of values of the variables, or an even sample of them; the whole map is kept.

With ``refine`` the cells around the best points are divided again, each time over two cells of the grid before. A grid that
is too large for one run is cut along its first variable into ``shards``, one of which each run evaluates.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, final

import numpy as np

from engine.model.parameters import Param
from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.evaluate import UNSTABLE, Assessment, Evaluator, Matrix
from optimizers.methods._base import MAX_SECONDS, Method
from optimizers.problem import Problem, ProblemError, Vector
from optimizers.search.blocks import in_blocks
from optimizers.search.maps import Combinations, around, places, sample
from optimizers.search.report import conclude, unstable_advice
from optimizers.search.result import GridMap, Monitor, Result, Status, kept_by
from optimizers.search.search import Stopped, Tracker

MOST_POINTS = 1_000_000
_AT_ONCE = 65_536
_MOST_IN_CELL = 4096
_SECOND_LOOK = 1000
"""So many of the points that the fast evaluation doubts are looked at again, the most promising ones."""


@final
class Grid(Method):
    """Full factorial grid, Sobol sequence or Latin hypercube, refined around the best points if asked for."""

    kind: ClassVar[str] = "grid"
    title: ClassVar[str] = "Grid"
    doc: ClassVar[str] = (
        "Evaluates every combination, keeps the whole map, and shows where the other methods should go."
    )
    source: ClassVar[str] = "D. C. Montgomery, Design and Analysis of Experiments, 8th ed., chapter 5"
    options: ClassVar[tuple[Param, ...]] = (
        Param(name="points", symbol="n", unit="1", doc="values of each variable; a number, or one for each", default=21, lower=2, upper=1e9),
        Param(name="refine", symbol="", unit="1", doc="how often the cells around the best points are divided", default=0, lower=0, upper=10),
        Param(name="cells", symbol="", unit="1", doc="how many of the best cells are divided each time", default=3, lower=1, upper=100),
        Param(
            name="sampling", symbol="", unit="1", doc="all combinations, or an even sample of them", default="full",
            shape="text", choices=("full", "sobol", "latin_hypercube"),
        ),
        Param(name="samples", symbol="N", unit="1", doc="points of a sample", default=1024, lower=1, upper=MOST_POINTS),
        Param(name="shards", symbol="", unit="1", doc="parts into which a full grid is cut along its first variable", default=1, lower=1, upper=1e6),
        Param(name="shard", symbol="", unit="1", doc="which part this run evaluates, from 0", default=0, lower=0, upper=1e6),
        Param(name="seed", symbol="", unit="1", doc="makes a sample repeatable", default=0, lower=0, upper=2**32 - 1),
        MAX_SECONDS,
    )  # fmt: skip

    @classmethod
    def check(cls, problem: Problem, options: Mapping[str, Any]) -> None:
        """Refuse too many points, ``points`` for something that is no variable, a shard that does not exist."""
        if options["sampling"] == "full":
            _size(problem, options)

    def minimize(
        self, problem: Problem, options: Mapping[str, Any], *, rng: np.random.Generator, monitor: Monitor
    ) -> Result:
        """Return the best point of the grid.

        Raises
        ------
        ProblemError
            Too many points, named; ``points`` for something that is no variable; a shard that does not exist.
        """
        design = design_of(problem, options, rng)
        total, rounds = len(design), int(options["refine"])
        tracker = Tracker(Evaluator(problem), monitor, budget=10**9)
        objective, violation = np.full(total, np.nan), np.full(total, np.nan)
        status, advice = (
            Status.CONVERGED,
            "the best point of the grid; between its points there may be better ones (refine, or gradient).",
        )
        try:
            kept = kept_by(monitor, self.kind)
            if kept is None:
                _evaluate(tracker, design, objective, violation, (0.0, 0.9 / (1 + rounds)))
            else:
                objective[:], violation[:] = kept["objective"], kept["violation"]
                tracker.evaluator.evaluations = int(kept["evaluations"])
                _take_over(tracker, design, objective, violation, np.asarray(kept["doubtful"], dtype=bool))
            if rounds:
                _refine(tracker, design, _order(objective, violation), rounds, int(options["cells"]))
        except Stopped:
            status, advice = Status.CANCELLED, "cancelled: this is the best point until then; the map is incomplete."
        if tracker.rank[0] >= UNSTABLE and status is Status.CONVERGED:
            status, advice = Status.INFEASIBLE, unstable_advice(problem.before)
        grid = GridMap(
            axes={axis.parameter: axis.value(x) for axis, x in zip(problem.axes, design.axes, strict=True)},
            objective=objective.reshape(design.shape),
            violation=violation.reshape(design.shape),
        )
        monitor.progress(0.95, "proving the optimum")
        best = problem.start() if tracker.best is None else tracker.best
        return conclude(tracker, best, status, advice, grid=grid)


def design_of(problem: Problem, options: Mapping[str, Any], rng: np.random.Generator) -> Design:
    """Return the points that a run with these options, complete and checked, evaluates first.

    Raises
    ------
    ProblemError
    """
    return _grid(problem, options) if options["sampling"] == "full" else _sample(problem, options, rng)


def first_look(tracker: Tracker, design: Design, first: int, last: int) -> Iterator[tuple[slice, Assessment]]:
    """Evaluate the points from ``first`` up to ``last``; yield which they were and what was found.

    Raises
    ------
    Stopped
        When cancelled.
    """
    for begin in range(first, last, _AT_ONCE):
        positions = design.rows(begin, min(begin + _AT_ONCE, last))
        for rows, found in in_blocks(tracker, positions, roughly=True):
            yield slice(begin + rows.start, begin + rows.stop), found


def _grid(problem: Problem, options: Mapping[str, Any]) -> Combinations:
    """Return the full grid, or the part of it that this run evaluates."""
    counts = _size(problem, options)
    axes = [places(axis, n) for axis, n in zip(problem.axes, counts, strict=True)]
    return Combinations([np.array_split(axes[0], int(options["shards"]))[int(options["shard"])], *axes[1:]])


def _size(problem: Problem, options: Mapping[str, Any]) -> list[int]:
    """Return how many values of each variable a full grid has; none is laid out."""
    counts = _counts(problem, options["points"])
    counts = [min(n, len(axis.levels) or n) for n, axis in zip(counts, problem.axes, strict=True)]
    shards, shard = int(options["shards"]), int(options["shard"])
    if shard >= shards:
        raise ProblemError(f"shard must be < shards {shards}, got {shard}", at=("method", "shard"))
    if shards > counts[0]:
        raise ProblemError(
            f"shards must be at most the points of {problem.axes[0].parameter}, {counts[0]}, got {shards}",
            at=("method", "shards"),
        )
    total = math.ceil(counts[0] / shards) * math.prod(counts[1:])
    if total > MOST_POINTS:
        sizes = (
            f"{counts[0]}^{len(counts)}" if len(set(counts)) == 1 and len(counts) > 3 else " x ".join(map(str, counts))
        )
        number = total if total < 10**9 else f"{float(total):.2g}" if total < 1e300 else "more than 1e300"
        of = "" if shards == 1 else f" in one of {shards} shards"
        raise ProblemError(
            f"points must make at most {MOST_POINTS} combinations, got {sizes} = {number}{of}: take fewer, a sobol sample, "
            "shards, or the method gradient",
            at=("method", "points"),
        )
    return counts


class _Listed:
    """Points that are no grid, one beside the other."""

    def __init__(self, positions: Matrix) -> None:
        self.axes = tuple(positions.T)
        self.shape = (len(positions),)
        self._positions = positions

    def __len__(self) -> int:
        return len(self._positions)

    def rows(self, first: int, last: int) -> Matrix:
        """Return the points number ``first`` up to ``last``."""
        return self._positions[first:last]


Design = Combinations | _Listed
"""Points in an order, of which any stretch can be had."""


def _sample(problem: Problem, options: Mapping[str, Any], rng: np.random.Generator) -> _Listed:
    for name in ("shards", "shard"):
        if int(options[name]) != (1 if name == "shards" else 0):
            raise ProblemError(f"{name} must be left out with a sample: take another seed instead", at=("method", name))
    return _Listed(sample(options["sampling"], int(options["samples"]), len(problem.axes), rng))


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


def _evaluate(
    tracker: Tracker, design: Design, objective: Vector, violation: Vector, share: tuple[float, float]
) -> None:
    """Evaluate all points, then those that are in doubt and would matter once more, with care."""
    total = len(design)
    doubtful = np.zeros(total, dtype=bool)
    for here, found in first_look(tracker, design, 0, total):
        objective[here], violation[here], doubtful[here] = found.objective, found.violation, found.doubtful
        tracker.monitor.progress(share[0] + share[1] * here.stop / total, f"{here.stop} of {total} points")
    _look_again(tracker, design, objective, violation, doubtful)


def _take_over(
    tracker: Tracker, design: Design, objective: Vector, violation: Vector, doubtful: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> None:  # fmt: skip
    """Go on from the scores of a first look that was taken elsewhere.

    Raises
    ------
    Stopped
        When cancelled, or when that look was.
    """
    order = _order(objective, violation)
    sure = order[~doubtful[order]] if not doubtful.all() else order
    index = int(sure[0])
    tracker.offer(design.rows(index, index + 1)[0], float(objective[index]), float(violation[index]))
    if np.isnan(violation).any():  # whoever looked was stopped
        raise Stopped(cancelled=True)
    _look_again(tracker, design, objective, violation, doubtful)


def _look_again(
    tracker: Tracker, design: Design, objective: Vector, violation: Vector, doubtful: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> None:  # fmt: skip
    """Evaluate points that are in doubt and would matter once more, with care."""
    if not tracker.evaluator.compiled:
        return
    order = _order(objective, violation)
    again = order[doubtful[order]][:_SECOND_LOOK]
    for first in range(0, len(again), 64):
        index = again[first : first + 64]
        found = tracker.assess(np.concatenate([design.rows(k, k + 1) for k in index.tolist()]))
        objective[index], violation[index] = found.objective, found.violation


def _order(objective: Vector, violation: Vector) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return indices from the best to the worst; where a metric is absent comes last."""
    excess = np.where(violation <= TOLERANCE, 0.0, np.nan_to_num(violation, nan=np.inf))
    return np.lexsort((np.nan_to_num(objective, nan=np.inf), excess))


def _refine(
    tracker: Tracker, design: Design, order: np.ndarray[tuple[int], np.dtype[np.intp]], rounds: int, cells: int
) -> None:  # fmt: skip
    """Divide the cells around the best points, and again around the best point of each."""
    axes = tracker.evaluator.problem.axes
    first = np.array(
        [1.0 / max(n - 1, 1) for n in design.shape] if isinstance(design, Combinations)
        else [len(design) ** (-1.0 / len(axes))] * len(axes)
    )  # fmt: skip
    per_axis = max(3, int(_MOST_IN_CELL ** (1.0 / len(axes))))
    counts = [min(n, per_axis) for n in design.shape] if isinstance(design, Combinations) else [per_axis] * len(axes)
    centres = _apart(design, order, 1.5 * first, cells)
    for number, start in enumerate(centres):
        centre, width = start, first
        for turn in range(rounds):
            finer = Combinations(
                [around(axis, x, w, max(n, 3)) for axis, x, w, n in zip(axes, centre, width, counts, strict=True)]
            )
            scores = np.full(len(finer), np.nan), np.full(len(finer), np.nan)
            done = (number + turn / rounds) / len(centres)
            _evaluate(tracker, finer, *scores, (0.9 * (1 + rounds * done) / (1 + rounds), 0.0))
            best = int(_order(*scores)[0])
            centre = finer.rows(best, best + 1)[0]
            width = 2 * width / (np.maximum(counts, 3) - 1)


def _apart(
    design: Design, order: np.ndarray[tuple[int], np.dtype[np.intp]], width: Vector, count: int
) -> list[Vector]:  # fmt: skip
    """Return the best points that do not lie in the cell of a better one."""
    chosen: list[Vector] = []
    for index in order[:_SECOND_LOOK].tolist():
        point = design.rows(index, index + 1)[0]
        if all((np.abs(point - other) > width).any() for other in chosen):
            chosen.append(point)
            if len(chosen) == count:
                break
    return chosen

"""Grid: every combination of values of the variables, or an even sample of them; the whole map is kept.

With ``refine`` the cells around the best points are divided again, each time over two cells of the grid before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

from engine.model.parameters import Param
from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.evaluate import UNSTABLE, Evaluator, Matrix
from optimizers.methods._base import MAX_SECONDS, Method
from optimizers.problem import Problem, ProblemError, Vector
from optimizers.search.blocks import in_blocks
from optimizers.search.candidates import packed, unpacked
from optimizers.search.maps import Combinations, around, places, sample
from optimizers.search.report import conclude, unstable_advice
from optimizers.search.result import GridMap, Keeper, Monitor, Result, Status, kept_by
from optimizers.search.search import Stopped, Tracker

MOST_POINTS = 1_000_000
_AT_ONCE = 65_536
_MOST_IN_CELL = 4096
_SECOND_LOOK = 1000
"""So many of the points that the fast evaluation doubts are looked at again, the most promising ones."""
_MOST_KEPT = 100_000
"""Points whose first look is kept, 3 MB: a run that is cut off later goes on from these."""

_WHOLE = "the best point of the grid; between its points there may be better ones (refine, or gradient)."
_DIVIDED = (
    "the best point of the grid and of the cells that were divided; beyond them, and along limits that depend on several "
    "variables, there may be better ones (gradient finds those near it)."
)

Flags = np.ndarray[tuple[int], np.dtype[np.bool_]]
Indices = np.ndarray[tuple[int], np.dtype[np.intp]]


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
        Param(name="seed", symbol="", unit="1", doc="makes a sample repeatable", default=0, lower=0, upper=2**32 - 1),
        MAX_SECONDS,
    )  # fmt: skip

    @classmethod
    def check(cls, problem: Problem, options: Mapping[str, Any]) -> None:
        """Refuse too many points, ``points`` for something that is no variable."""
        if options["sampling"] == "full":
            _size(problem, options)

    def minimize(
        self, problem: Problem, options: Mapping[str, Any], *, rng: np.random.Generator, monitor: Monitor
    ) -> Result:
        """Return the best point of the grid.

        Raises
        ------
        ProblemError
            Too many points, named; ``points`` for something that is no variable.
        """
        design = _grid(problem, options) if options["sampling"] == "full" else _sample(problem, options, rng)
        scores, rounds = _Scores.none(len(design)), int(options["refine"])
        tracker = Tracker(Evaluator(problem), monitor, budget=10**9)
        status, advice = Status.CONVERGED, _DIVIDED if rounds else _WHOLE
        try:
            kept = kept_by(monitor, self.kind)
            if kept is not None:
                _take_over(tracker, design, scores, kept)
            _evaluate(
                tracker,
                design,
                scores,
                (0.0, 0.9 / (1 + rounds)),
                keeper=monitor if isinstance(monitor, Keeper) else None,
            )
            if rounds:
                _refine(tracker, design, scores.order(), rounds, int(options["cells"]))
        except Stopped:
            status, advice = Status.CANCELLED, "cancelled: this is the best point until then; the map is incomplete."
        if tracker.rank[0] >= UNSTABLE and status is Status.CONVERGED:
            status, advice = Status.INFEASIBLE, unstable_advice(problem.before)
        grid = GridMap(
            axes={axis.parameter: axis.value(x) for axis, x in zip(problem.axes, design.axes, strict=True)},
            objective=scores.objective.reshape(design.shape),
            violation=scores.violation.reshape(design.shape),
        )
        monitor.progress(0.95, "proving the optimum")
        best = problem.start() if tracker.best is None else tracker.best
        return conclude(tracker, best, status, advice, grid=grid)


@dataclass(kw_only=True, eq=False)
class _Scores:
    """What is known of the points of a design, NaN where nothing is; the first ``done`` of them have had their first look."""

    objective: Vector
    violation: Vector
    doubtful: Flags
    done: int = 0

    @staticmethod
    def none(count: int) -> _Scores:
        """Return what is known of so many points at first."""
        return _Scores(
            objective=np.full(count, np.nan), violation=np.full(count, np.nan), doubtful=np.zeros(count, dtype=bool)
        )

    def document(self, tracker: Tracker) -> dict[str, Any]:
        """Return the first look until here in plain texts, and which of the points were better than all before them."""
        columns = np.column_stack([self.objective, self.violation, self.doubtful])
        better = [point.evaluation - 1 for point in tracker.history]
        count = tracker.evaluator.evaluations
        return {"kind": Grid.kind, "evaluations": count, "looked": packed(columns[: self.done]), "better": better}

    def restore(self, document: Mapping[str, Any]) -> None:
        """Be what such texts tell."""
        columns = unpacked(document["looked"], 3)
        self.done = len(columns)
        self.objective[: self.done], self.violation[: self.done], doubtful = columns.T
        self.doubtful[: self.done] = doubtful != 0

    def order(self) -> Indices:
        """Return indices from the best to the worst; where a metric is absent comes last."""
        excess = np.where(self.violation <= TOLERANCE, 0.0, np.nan_to_num(self.violation, nan=np.inf))
        return np.lexsort((np.nan_to_num(self.objective, nan=np.inf), excess))


def _grid(problem: Problem, options: Mapping[str, Any]) -> Combinations:
    """Return the full grid."""
    counts = _size(problem, options)
    return Combinations([places(axis, n) for axis, n in zip(problem.axes, counts, strict=True)])


def _size(problem: Problem, options: Mapping[str, Any]) -> list[int]:
    """Return how many values of each variable a full grid has; none is laid out."""
    counts = _counts(problem, options["points"])
    counts = [min(n, len(axis.levels) or n) for n, axis in zip(counts, problem.axes, strict=True)]
    total = math.prod(counts)
    if total > MOST_POINTS:
        sizes = (
            f"{counts[0]}^{len(counts)}" if len(set(counts)) == 1 and len(counts) > 3 else " x ".join(map(str, counts))
        )
        number = total if total < 10**9 else f"{float(total):.2g}" if total < 1e300 else "more than 1e300"
        raise ProblemError(
            f"points must make at most {MOST_POINTS} combinations, got {sizes} = {number}: take fewer, a sobol sample, "
            "or the method gradient",
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
    tracker: Tracker, design: Design, scores: _Scores, share: tuple[float, float], *, keeper: Keeper | None = None
) -> None:
    """Evaluate all points that have had no first look, then those that are in doubt and would matter once more, with care.

    Raises
    ------
    Stopped
        When cancelled.
    """
    total = len(design)
    while scores.done < total:
        first = scores.done
        positions = design.rows(first, min(first + _AT_ONCE, total))
        for rows, found in in_blocks(tracker, positions, roughly=True):
            here = slice(first + rows.start, first + rows.stop)
            scores.objective[here], scores.violation[here] = found.objective, found.violation
            scores.doubtful[here] = found.doubtful
            scores.done = here.stop
            if keeper is not None and scores.done <= _MOST_KEPT:
                keeper.keep(scores.document(tracker))
            tracker.monitor.progress(share[0] + share[1] * here.stop / total, f"{here.stop} of {total} points")
    if not tracker.evaluator.compiled:
        return
    order = scores.order()
    again = order[scores.doubtful[order]][:_SECOND_LOOK]
    for first in range(0, len(again), 64):
        index = again[first : first + 64]
        careful = tracker.assess(np.concatenate([design.rows(k, k + 1) for k in index.tolist()]))
        scores.objective[index], scores.violation[index] = careful.objective, careful.violation


def _take_over(tracker: Tracker, design: Design, scores: _Scores, kept: Mapping[str, Any]) -> None:
    """Go on from where a run that was cut off was."""
    scores.restore(kept)
    tracker.evaluator.evaluations = int(kept["evaluations"])
    for index in kept["better"]:
        position = design.rows(index, index + 1)[0]
        tracker.offer(position, float(scores.objective[index]), float(scores.violation[index]), index + 1)


def _refine(tracker: Tracker, design: Design, order: Indices, rounds: int, cells: int) -> None:
    """Divide the cells around the best points, and again around the best point of each."""
    axes = tracker.evaluator.problem.axes
    first = np.array(
        [1.0 / max(n - 1, 1) for n in design.shape] if isinstance(design, Combinations)
        else [len(design) ** (-1.0 / len(axes))] * len(axes)
    )  # fmt: skip
    per_axis = max(3, int(_MOST_IN_CELL ** (1.0 / len(axes))))
    counts = np.clip(design.shape if isinstance(design, Combinations) else per_axis, 3, per_axis)
    centres = _apart(design, order, 1.5 * first, cells)
    for number, start in enumerate(centres):
        centre, width = start, first
        for turn in range(rounds):
            reach = np.where(counts > 3, width, width / 2)  # three values over both cells are those that there were
            finer = Combinations(
                [around(axis, x, w, n) for axis, x, w, n in zip(axes, centre, reach, counts.tolist(), strict=True)]
            )
            scores, done = _Scores.none(len(finer)), (number + turn / rounds) / len(centres)
            _evaluate(tracker, finer, scores, (0.9 * (1 + rounds * done) / (1 + rounds), 0.0))
            best = int(scores.order()[0])
            centre = finer.rows(best, best + 1)[0]
            width = 2 * reach / (counts - 1)


def _apart(design: Design, order: Indices, width: Vector, count: int) -> list[Vector]:
    """Return the best points that do not lie in the cell of a better one."""
    chosen: list[Vector] = []
    for index in order[:_SECOND_LOOK].tolist():
        point = design.rows(index, index + 1)[0]
        if all((np.abs(point - other) > width).any() for other in chosen):
            chosen.append(point)
            if len(chosen) == count:
                break
    return chosen

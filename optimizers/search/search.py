"""What a method does between evaluations: remembers the best point, obeys cancel and budget, descends locally.

The local descent is sequential quadratic programming over all scenarios at once, with the worst one above the epigraph:

    minimise γ   subject to   Σ_g w_g f_g(x, s) ≤ γ,   excess_g(x, s) ≤ -margin_g   for all s and g,   0 ≤ x ≤ 1

so that the maximum over scenarios, which has no derivative, never appears; first derivatives are exact.

References
----------
D. Kraft, "A software package for sequential quadratic programming", DFVLR-FB 88-28 (1988), as scipy's SLSQP.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from scipy.optimize import Bounds
from scipy.optimize import minimize as scipy_minimize

from engine.model.interruption import interruptible
from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.constraint_violation import BROKEN, excess, excess_slopes
from optimizers.evaluation.effort import Stage, during, elapsed
from optimizers.evaluation.evaluate import Assessment, Evaluator, Local, Matrix
from optimizers.problem import Vector
from optimizers.search.result import HistoryPoint, Monitor

SAFETY = 1e-7
"""The descent stays so far inside the bounds, because fast and exact metrics agree to about that."""


_PROGRESS = 0.2
"""How often (s) the progress within a stage is told, at most."""

NEAR = 0.01
"""Moves, as parts of the range of each variable, for which an optimum is proven."""
STATIONARY = 1e-5
"""What the slopes around an optimum promise for such moves, relative to the objective, is no more than this."""

_NEAR = 1e-3
"""A start that breaks its bounds by less is brought back by the descent itself; the way to the middle would lose it."""


class Stopped(Exception):  # noqa: N818 - a request to stop is no error
    """The search has to stop: cancelled, or the budget is used up."""

    def __init__(self, *, cancelled: bool) -> None:
        super().__init__()
        self.cancelled = cancelled


class Tracker:
    """The best point so far, its history, and whether to go on.

    ``margins`` (G,) is the relative distance that a point found by slopes must keep from the bounds to count as feasible.
    ``stationarity`` is the gain, relative to the objective, that the slopes of all active functions promise for moves of 1 % of
    the ranges from the best point; None where nobody has looked.

    Parameters
    ----------
    evaluator : Evaluator
    monitor : Monitor
    budget : int
        Largest number of evaluations.
    """

    def __init__(self, evaluator: Evaluator, monitor: Monitor, budget: int) -> None:
        self.evaluator = evaluator
        self.evaluator.expect(budget)
        self.monitor = monitor
        self.budget = budget
        self.history: list[HistoryPoint] = []
        self.best: Vector | None = None
        self.rank = (np.inf, np.inf)
        self.stationarity: float | None = None
        self.margins = np.zeros(len(evaluator.problem.goals))
        self.started = self._told = time.perf_counter()
        self._stage: tuple[float, float, str, int, int] | None = None

    def stage(self, first: float, last: float, message: str, *, evaluations: int) -> None:
        """Begin what takes the progress from ``first`` to ``last``, with about so many ``evaluations``."""
        self._stage = (first, last, message, self.evaluator.evaluations, evaluations)
        self.monitor.progress(first, message)

    def assess(self, positions: Matrix, *, roughly: bool = False) -> Assessment:
        """Evaluate points, remember the best of them; ``roughly`` for a first look at many, where doubt does not count.

        Raises
        ------
        Stopped
            When cancelled or out of budget.
        """
        before = self.evaluator.evaluations
        with self._evaluating(len(positions)):
            with during(Stage.SCREENING):
                found = self.evaluator.assess(positions, roughly=roughly)
            index = self._first_unsure(positions, found, roughly=roughly)
            while index is not None:
                found.replace(index, self.evaluator.settled(positions[index]))
                index = self._first_unsure(positions, found, roughly=roughly)
        for index in _improving(found, roughly=roughly):
            self.offer(
                positions[index], float(found.objective[index]), float(found.violation[index]), before + index + 1
            )
        return found

    def _first_unsure(self, positions: Matrix, found: Assessment, *, roughly: bool) -> int | None:
        """Return the first of the points that would become the best of which the exact path may say something else."""
        for index in _improving(found, roughly=roughly):
            better = _rank(float(found.objective[index]), float(found.violation[index])) < self.rank
            if better and found.violation[index] < BROKEN and self._unsure(positions[index], found, index):
                return index
        return None

    def _unsure(self, position: Vector, found: Assessment, index: int) -> bool:
        return bool(found.doubtful[index]) or self.evaluator.refutes(position)

    def local(self, position: Vector) -> Local | None:
        """Evaluate one point with slopes, remember it; None where a metric has no value.

        Raises
        ------
        Stopped
            When cancelled or out of budget.
        """
        with self._evaluating(1), during(Stage.REFINING):
            found = self.evaluator.local(position)
        if found is not None:
            objective, violation = self._ranked(found.values)
            if found.doubtful and _rank(objective, violation) < self.rank:
                settled = self.evaluator.settled(position)
                objective, violation = self._ranked(settled.values[0])
                violation = max(violation, float(settled.violation[0]))
            self.offer(position, objective, violation)
        return found

    def _ranked(self, values: Matrix) -> tuple[float, float]:
        """Return objective and violation of metric values (S, G), with the margins kept."""
        return float(self.evaluator.objectives(values).max()), float(
            self.evaluator.violations(values, self.margins).max()
        )

    @contextmanager
    def _evaluating(self, count: int) -> Iterator[None]:
        """Evaluate so many points inside: within the budget, until somebody cancels, and with progress."""
        self._go_on()
        if self.evaluator.evaluations + count > self.budget:
            raise Stopped(cancelled=False)
        with interruptible(self._go_on if self.best is not None else _never):
            yield
        now = time.perf_counter()
        if self._stage is not None and now - self._told >= _PROGRESS:
            self._told = now
            first, last, message, before, expected = self._stage
            done = 1 - math.exp(-(self.evaluator.evaluations - before) / expected)
            self.monitor.progress(first + (last - first) * done, message)

    def _go_on(self) -> None:
        if self.monitor.cancelled():
            raise Stopped(cancelled=True)

    def offer(self, position: Vector, objective: float, violation: float, evaluation: int | None = None) -> None:
        """Remember a point if it is the best so far; ``evaluation`` is its number, by default that of the latest."""
        rank = _rank(objective, violation)
        if rank < self.rank:
            self.rank, self.best, self.stationarity = rank, np.array(position, dtype=float), None
            variables = self.evaluator.problem.values(self.best)
            count = self.evaluator.evaluations if evaluation is None else evaluation
            seconds = elapsed()
            point = HistoryPoint(
                evaluation=count, objective=objective, violation=violation, variables=variables,
                seconds=self.seconds if seconds is None else seconds,
            )  # fmt: skip
            self.history.append(point)
            self.monitor.best(count, objective, violation, variables)

    def document(self) -> dict[str, Any]:
        """Return in plain numbers how far it has come, what is infinite as None; there must be a best point."""
        assert self.best is not None
        return {
            "best": self.best.tolist(),
            "rank": [_plain(number) for number in self.rank],
            "evaluations": self.evaluator.evaluations,
            "history": [
                [
                    point.evaluation,
                    _plain(point.objective),
                    _plain(point.violation),
                    point.seconds,
                    dict(point.variables),
                ]
                for point in self.history
            ],
        }

    def restore(self, document: Mapping[str, Any]) -> None:
        """Be where such numbers say, with all that was found before."""
        self.evaluator.evaluations = int(document["evaluations"])
        violation, objective = (np.inf if number is None else float(number) for number in document["rank"])
        self.offer(np.array(document["best"], dtype=float), objective, violation)
        told = document.get("history")
        if told:  # earlier versions kept none
            self.history = [
                HistoryPoint(
                    evaluation=int(count), objective=np.nan if value is None else float(value),
                    violation=np.inf if excess is None else float(excess), seconds=float(seconds), variables=variables,
                )
                for count, value, excess, seconds, variables in told
            ]  # fmt: skip

    def prove(self, position: Vector, promised: float) -> None:
        """Take note of the relative gain that slopes promise around a point; of the best one if that lies no farther away."""
        if self.best is not None and np.abs(self.best - position).max() <= NEAR:
            self.stationarity = promised if self.stationarity is None else min(promised, self.stationarity)

    @property
    def seconds(self) -> float:
        """Time since the search began."""
        return time.perf_counter() - self.started


def _plain(number: float) -> float | None:
    return float(number) if np.isfinite(number) else None


def _never() -> None:
    """Let an evaluation come to its end: without any point there is no result."""


def _rank(objective: float, violation: float) -> tuple[float, float]:
    """Return what a point is compared by: the smaller, the better."""
    return violation if violation > TOLERANCE else 0.0, objective if np.isfinite(objective) else np.inf


def _improving(found: Assessment, *, roughly: bool) -> list[int]:
    """Return the points that are better than all before them: the history does not depend on how points are put together."""
    objective = np.where(np.isnan(found.objective), np.inf, found.objective)
    excess = np.where(found.violation <= TOLERANCE, 0.0, found.violation)
    places = np.empty(len(objective), dtype=int)
    places[np.lexsort((objective, excess))] = np.arange(len(objective))
    if roughly and not found.doubtful.all():
        places[found.doubtful] = len(objective)
    indices: list[int] = np.flatnonzero(places == np.minimum.accumulate(places)).tolist()
    return indices


class _Enough(Exception):  # noqa: N818 - nothing is wrong, the descent has had its share
    """A descent has used its evaluations."""


class Descent:
    """Sequential quadratic programming from one point.

    Parameters
    ----------
    tracker : Tracker
    margins : ndarray, shape (G,)
        Relative distance that each goal keeps from its bounds.
    """

    def __init__(self, tracker: Tracker, margins: Vector) -> None:
        self._tracker = tracker
        self._evaluator = tracker.evaluator
        self._margins = margins
        self._points: dict[bytes, Local | None] = {}
        self._left = 0
        goals = self._evaluator.problem.goals
        self._bounds = [(g, bound, sign) for g, goal in enumerate(goals) if goal.hard for bound, sign in goal.bounds]

    def run(self, start: Vector, *, evaluations: int) -> None:
        """Descend from ``start``; the tracker remembers the best point passed.

        Raises
        ------
        Stopped
            When cancelled or out of budget.
        """
        self._left = evaluations
        try:
            first = self._at(start)
            if first is None:
                return
            if self._excess(first.values).max(initial=-np.inf) > _NEAR:
                # First into the feasible region, or as near to it as possible; then along its boundary.
                start = self._solve(start, first, feasibility=True)
            self._solve(start, first, feasibility=False)
        except _Enough:
            return

    def _solve(self, start: Vector, first: Local, *, feasibility: bool) -> Vector:
        """Minimise the objective under all bounds, or the largest excess over them."""
        n = len(start)
        scale = 1.0 if feasibility else max(float(np.abs(self._evaluator.objectives(first.values)).max()), 1e-300)
        begin = self._at(start) or first
        level = self._excess(begin.values) if feasibility else self._evaluator.objectives(begin.values) / scale
        slope_of_level = np.append(np.zeros(n), 1.0)
        last = begin
        # Feasible is enough: what lies further inside is a matter of the objective.
        floor = 0.0 if feasibility else -np.inf

        def constraints(z: Vector) -> Vector:
            here = self._at(np.clip(z[:n], 0.0, 1.0))
            values = last.values if here is None else here.values
            excess = self._excess(values)
            above = excess if feasibility else self._evaluator.objectives(values) / scale
            room = z[n] - above if feasibility else np.concatenate([z[n] - above, -excess])
            return np.full_like(room, -BROKEN) if here is None else room

        def jacobian(z: Vector) -> Matrix:
            nonlocal last
            last = self._at(np.clip(z[:n], 0.0, 1.0)) or last
            excess = self._excess_slopes(last)
            above = excess if feasibility else self._evaluator.objective_slopes(last) / scale
            rows = np.hstack([-above, np.ones((len(above), 1))])
            if not feasibility:
                rows = np.vstack([rows, np.hstack([-excess, np.zeros((len(excess), 1))])])
            # scipy misreads a gradient that is a view of something else.
            return np.ascontiguousarray(rows)

        # Its stubs know no constraint with a Jacobian of its own.
        solver: Any = scipy_minimize
        outcome = solver(
            lambda z: float(z[n]), np.append(start, level.max()), jac=lambda _: slope_of_level, method="SLSQP",
            bounds=Bounds(np.append(np.zeros(n), floor), np.append(np.ones(n), np.inf)),
            constraints={"type": "ineq", "fun": constraints, "jac": jacobian}, options={"maxiter": 100, "ftol": 1e-8},
        )  # fmt: skip
        return np.clip(outcome.x[:n], 0.0, 1.0) if np.isfinite(outcome.x).all() else start

    def _at(self, x: Vector) -> Local | None:
        key = x.tobytes()
        if key not in self._points:
            if self._left <= 0:
                raise _Enough
            self._left -= 1
            self._points[key] = self._tracker.local(x)
        return self._points[key]

    def _excess(self, values: Matrix) -> Vector:
        """Return every bound's excess in every scenario, bound by bound."""
        rows = [excess(values[:, g], bound, sign) + self._margins[g] for g, bound, sign in self._bounds]
        return np.concatenate(rows) if rows else np.zeros(0)

    def _excess_slopes(self, local: Local) -> Matrix:
        rows = [excess_slopes(local.values[:, g], local.slopes[:, g], bound, sign) for g, bound, sign in self._bounds]
        return np.concatenate(rows) if rows else np.zeros((0, local.slopes.shape[2]))

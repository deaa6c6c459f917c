"""What a method does between evaluations: remembers the best point, obeys cancel and budget, descends locally.

The local descent is sequential quadratic programming over all scenarios at once, with the worst one above the epigraph:

    minimise γ   subject to   Σ_g w_g f_g(x, s) ≤ γ,   excess_g(x, s) ≤ -margin_g   for all s and g,   0 ≤ x ≤ 1

so that the maximum over scenarios, which has no derivative, never appears; first derivatives are exact.

References
----------
D. Kraft, "A software package for sequential quadratic programming", DFVLR-FB 88-28 (1988), as scipy's SLSQP.
"""

from __future__ import annotations

import time

import numpy as np
from scipy.optimize import minimize as scipy_minimize

from optimizers.certificate import BROKEN, TOLERANCE, signed_excess
from optimizers.evaluate import Assessment, Evaluator, Local, Matrix
from optimizers.problem import Vector
from optimizers.result import HistoryPoint, Monitor

SAFETY = 1e-7
"""The descent stays so far inside the bounds, because fast and exact metrics agree to about that."""


class Stopped(Exception):  # noqa: N818 - a request to stop is no error
    """The search has to stop: cancelled, or the budget is used up."""

    def __init__(self, *, cancelled: bool) -> None:
        super().__init__()
        self.cancelled = cancelled


class Tracker:
    """The best point so far, its history, and whether to go on.

    Parameters
    ----------
    evaluator : Evaluator
    monitor : Monitor
    budget : int
        Largest number of evaluations.
    """

    def __init__(self, evaluator: Evaluator, monitor: Monitor, budget: int) -> None:
        self.evaluator = evaluator
        self.monitor = monitor
        self.budget = budget
        self.history: list[HistoryPoint] = []
        self.best: Vector | None = None
        self.rank = (np.inf, np.inf)
        self.started = time.perf_counter()

    def assess(self, positions: Matrix) -> Assessment:
        """Evaluate points, remember the best of them.

        Raises
        ------
        Stopped
            When cancelled or out of budget.
        """
        if self.monitor.cancelled():
            raise Stopped(cancelled=True)
        if self.evaluator.evaluations + len(positions) > self.budget:
            raise Stopped(cancelled=False)
        found = self.evaluator.assess(positions)
        index = int(found.order()[0])
        self.offer(positions[index], float(found.objective[index]), float(found.violation[index]))
        return found

    def local(self, position: Vector) -> Local | None:
        """Evaluate one point with slopes.

        Raises
        ------
        Stopped
            When cancelled or out of budget.
        """
        if self.monitor.cancelled():
            raise Stopped(cancelled=True)
        if self.evaluator.evaluations >= self.budget:
            raise Stopped(cancelled=False)
        return self.evaluator.local(position)

    def offer(self, position: Vector, objective: float, violation: float) -> None:
        """Remember a point if it is the best so far."""
        rank = (violation if violation > TOLERANCE else 0.0, objective if np.isfinite(objective) else np.inf)
        if rank < self.rank:
            self.rank, self.best = rank, np.array(position, dtype=float)
            variables = self.evaluator.problem.values(self.best)
            count = self.evaluator.evaluations
            self.history.append(HistoryPoint(evaluation=count, objective=objective, violation=violation, variables=variables))
            self.monitor.best(count, objective, violation, variables)

    @property
    def seconds(self) -> float:
        """Time since the search began."""
        return time.perf_counter() - self.started


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
        self._points: dict[bytes, Matrix] = {}
        self._locals: dict[bytes, Local] = {}
        self._bounded = [i for i, goal in enumerate(self._evaluator.problem.goals) if goal.lower is not None or goal.upper is not None]

    def run(self, start: Vector, *, iterations: int) -> Vector:
        """Return the best point of a descent; ``start`` itself if nothing better was found.

        Raises
        ------
        Stopped
            When cancelled or out of budget.
        """
        local = self._slopes(start)
        if local is None:
            return start
        count = len(start)
        objective = self._evaluator.objectives(local.values)
        scale = max(float(np.abs(objective).max()), 1e-300)
        feasible = self._excess(local.values).max(initial=-np.inf) <= 0
        point = self._solve(start, scale, iterations) if feasible else None
        if point is None:
            # First into the feasible region, or as near to it as possible; then along its boundary.
            inside = self._solve(start, None, iterations)
            point = self._solve(inside, scale, iterations)
            candidates = np.array([start, inside, point])
        else:
            candidates = np.array([start, point])
        ranked = self._tracker.assess(candidates.reshape(-1, count))
        return candidates[int(ranked.order()[0])]

    def _solve(self, start: Vector, scale: float | None, iterations: int) -> Vector:
        """Minimise the objective divided by ``scale``, or the largest excess if that is None."""
        first = self._level(start, scale)
        z0 = np.append(start, first.max(initial=0.0))
        n = len(start)
        gradient = np.append(np.zeros(n), 1.0)

        def constraints(z: Vector) -> Vector:
            x = np.clip(z[:n], 0.0, 1.0)
            level = z[n] - self._level(x, scale)
            return level if scale is None else np.concatenate([level, -self._limits(x)])

        def jacobian(z: Vector) -> Matrix:
            x = np.clip(z[:n], 0.0, 1.0)
            local = self._slopes(x)
            rows = self._level_slopes(local, scale)
            level = np.hstack([-rows, np.ones((len(rows), 1))])
            if scale is not None:
                limits = self._excess_slopes(local)
                level = np.vstack([level, np.hstack([-limits, np.zeros((len(limits), 1))])])
            return np.ascontiguousarray(level)

        outcome = scipy_minimize(
            lambda z: float(z[n]), z0, jac=lambda _: gradient, method="SLSQP",
            bounds=[*([(0.0, 1.0)] * n), (None, None)],
            constraints={"type": "ineq", "fun": constraints, "jac": jacobian},
            options={"maxiter": iterations, "ftol": 1e-7},
        )  # fmt: skip
        return np.clip(outcome.x[:n], 0.0, 1.0) if np.isfinite(outcome.x).all() else start

    def _values(self, x: Vector) -> Matrix:
        key = x.tobytes()
        if key not in self._points:
            if key in self._locals:
                return self._locals[key].values
            found = self._tracker.assess(x[None])
            values = found.values[0]
            # Worse than anything that has a value, and worse still the faster it diverges.
            self._points[key] = values if not np.isnan(values).any() else np.full_like(values, np.nan)
        return self._points[key]

    def _slopes(self, x: Vector) -> Local | None:
        key = x.tobytes()
        if key not in self._locals:
            local = self._tracker.local(x)
            if local is None:
                return self._last
            self._locals[key] = local
            self._last: Local | None = local
        return self._locals[key]

    def _level(self, x: Vector, scale: float | None) -> Vector:
        values = self._values(x)
        if np.isnan(values).any():
            return np.full(len(values) if scale is not None else max(1, self._excess(values).size), BROKEN)
        return self._excess(values) if scale is None else self._evaluator.objectives(values) / scale

    def _level_slopes(self, local: Local | None, scale: float | None) -> Matrix:
        assert local is not None
        if scale is None:
            return self._excess_slopes(local)
        weights = np.zeros(local.values.shape[1])
        for goal in self._evaluator.problem.objectives:
            weights[goal] = self._evaluator.objective_weight(goal) / scale
        return np.einsum("g,sgv->sv", weights, local.slopes)

    def _limits(self, x: Vector) -> Vector:
        values = self._values(x)
        return np.full(self._excess(values).size, BROKEN) if np.isnan(values).any() else self._excess(values)

    def _excess(self, values: Matrix) -> Vector:
        """Return every bound's excess in every scenario, one vector."""
        goals = self._evaluator.problem.goals
        rows = [signed_excess(goals[g], values[:, g]) + self._margins[g] for g in self._bounded]
        return np.concatenate([row.ravel() for row in rows]) if rows else np.zeros(0)

    def _excess_slopes(self, local: Local) -> Matrix:
        rows = []
        for g in self._bounded:
            goal = self._evaluator.problem.goals[g]
            for bound, sign in ((goal.upper, 1.0), (goal.lower, -1.0)):
                if bound is not None:
                    rows.append(sign * local.slopes[:, g] / (abs(bound) or 1.0))
        return np.concatenate(rows) if rows else np.zeros((0, local.slopes.shape[2]))

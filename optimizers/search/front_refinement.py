"""Points of a front moved onto its true place, one after the other: the ends, then along the front, then by slopes.

Where it is after each point is a state, from which the rest goes on as it would have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from optimizers.evaluation.evaluate import Assessment, Evaluator, Matrix
from optimizers.problem import Problem, Sense, Vector
from optimizers.search.candidates import Candidates, packed, unpacked
from optimizers.search.cross_entropy import search_around
from optimizers.search.result import Quiet
from optimizers.search.search import SAFETY, Descent, Tracker

ROUNDS, CLOUD, DESCENT = 12, 128, 15
"""Evaluations that move one point onto the front: rounds of a cloud of so many points, and those with slopes."""


@dataclass(kw_only=True, eq=False)
class Refinement:
    """How far the front is moved: sweep 0 finds the ends, sweeps 1 to m follow it, the last one polishes.

    ``positions`` (B, V) and ``limits`` (B, m) are what a sweep works off, from ``place`` on; ``last`` is where the point before
    ended.
    """

    sweep: int = 0
    place: int = 0
    positions: Matrix | None = None
    limits: Matrix | None = None
    last: Vector | None = None

    def document(self) -> dict[str, Any]:
        """Return the state in plain numbers."""
        texts = {name: None if rows is None else packed(rows) for name, rows in self._arrays().items()}
        return {"sweep": self.sweep, "place": self.place, **texts}

    @staticmethod
    def of(document: Mapping[str, Any], problem: Problem) -> Refinement:
        """Return the state that such numbers describe."""
        columns = {"positions": len(problem.axes), "limits": len(problem.objectives), "last": len(problem.axes)}
        rows = {
            name: None if document[name] is None else unpacked(document[name], count) for name, count in columns.items()
        }
        last = rows["last"]
        return Refinement(
            sweep=int(document["sweep"]),
            place=int(document["place"]),
            positions=rows["positions"],
            limits=rows["limits"],
            last=None if last is None else last[0],
        )

    def run(
        self,
        tracker: Tracker,
        candidates: Candidates,
        points: int,
        rng: np.random.Generator,
        *,
        keep: Callable[[], None],
    ) -> None:
        """Move the front; the points that are met on the way are taken note of.

        Raises
        ------
        Stopped
            When cancelled or out of budget.
        """
        if not len(candidates.positions):
            return
        objectives = len(candidates.problem.objectives)
        if not tracker.evaluator.compiled:
            self.sweep = max(self.sweep, objectives + 1)
        while self.sweep <= objectives + 1:
            if self.positions is None or self.limits is None:
                self._begin(candidates, points)
            assert self.positions is not None
            count = objectives if self.sweep == 0 else len(self.positions)
            while self.place < count:
                self._move(tracker, candidates, rng, count)
                self.place += 1
                keep()
            self.sweep, self.place, self.positions, self.limits, self.last = self.sweep + 1, 0, None, None, None

    def _begin(self, candidates: Candidates, points: int) -> None:
        """Decide what the sweep works off."""
        objectives = len(candidates.problem.objectives)
        if self.sweep > 0:
            candidates.thin(points)
        order = np.arange(len(candidates.positions))
        if 0 < self.sweep <= objectives:
            # Each point begins at its refined neighbour.
            order = np.argsort(candidates.values[:, self.sweep - 1])
            self.place = 1
        self.positions, self.limits = candidates.positions[order].copy(), candidates.values[order].copy()
        self.last = self.positions[0]

    def _move(self, tracker: Tracker, candidates: Candidates, rng: np.random.Generator, count: int) -> None:
        """Move one point."""
        assert self.positions is not None
        assert self.limits is not None
        assert self.last is not None
        objectives, k = len(candidates.problem.objectives), self.place
        if self.sweep == 0:
            start = candidates.positions[candidates.values[:, k].argmin()]
            _search(tracker, candidates, _Aim(k, np.full(objectives, np.inf)), start, rng)
        elif self.sweep <= objectives:
            share = (self.sweep - 1 + k / count) / objectives
            tracker.monitor.progress(0.5 + 0.2 * share, f"following the front, point {k + 1} of {count}")
            self.last = _search(tracker, candidates, _Aim(self.sweep - 1, self.limits[k]), self.last, rng)
        else:
            tracker.monitor.progress(0.7 + 0.2 * k / count, f"polishing point {k + 1} of {count}")
            polished = _descend(tracker, candidates, _Aim(k % objectives, self.limits[k]), self.positions[k])
            if polished is not None:
                candidates.replace(self.positions[k], polished, tracker.assess(polished[None]))

    def _arrays(self) -> dict[str, Matrix | None]:
        last = None if self.last is None else self.last[None]
        return {"positions": self.positions, "limits": self.limits, "last": last}


@dataclass(frozen=True, eq=False)
class _Aim:
    """Minimise objective ``lead`` while the others stay within ``limits`` (m,)."""

    lead: int
    limits: Vector

    def excess(self, values: Matrix) -> Vector:
        """Return by how much rows of objectives (B, m) leave the limits, relative to them."""
        others = [i for i in range(values.shape[1]) if i != self.lead and np.isfinite(self.limits[i])]
        sizes = np.where(self.limits[others] == 0.0, 1.0, np.abs(self.limits[others]))
        return np.asarray(((values[:, others] - self.limits[others]) / sizes).max(axis=1, initial=0.0))

    def problem(self, problem: Problem) -> Problem:
        """Return the problem with one objective, the limits of the others among its bounds."""
        goals = []
        for g, goal in enumerate(problem.goals):
            i = problem.objectives.index(g) if g in problem.objectives else self.lead
            limit = math.inf if i == self.lead else float(self.limits[i])
            if i == self.lead:
                goals.append(goal)
            elif math.isfinite(limit) and goal.sense is Sense.MAXIMIZE:
                lower = -limit if goal.lower is None else max(-limit, goal.lower)
                goals.append(replace(goal, sense=None, lower=lower))
            elif math.isfinite(limit):
                upper = limit if goal.upper is None else min(limit, goal.upper)
                goals.append(replace(goal, sense=None, upper=upper))
            elif goal.bounded:
                goals.append(replace(goal, sense=None))
        return replace(problem, goals=tuple(goals))


def _search(tracker: Tracker, candidates: Candidates, aim: _Aim, start: Vector, rng: np.random.Generator) -> Vector:
    """Return the best point for an aim around ``start``, found without slopes."""

    def ranking(positions: Matrix, found: Assessment) -> tuple[Vector, Vector]:
        candidates.offer(positions, found)
        values = candidates.minimised(found.values)
        return np.maximum(found.violation, aim.excess(values)), values[:, aim.lead]

    return search_around(tracker, start, rng, rounds=ROUNDS, size=CLOUD, ranking=ranking)


def _descend(tracker: Tracker, candidates: Candidates, aim: _Aim, start: Vector) -> Vector | None:
    """Return a point improved for an aim by slopes."""
    alone = aim.problem(candidates.problem)
    inner = Tracker(Evaluator(alone), Quiet(tracker.monitor), tracker.budget - tracker.evaluator.evaluations)
    try:
        Descent(inner, np.full(len(alone.goals), SAFETY)).run(start, evaluations=DESCENT)
    finally:
        tracker.evaluator.evaluations += inner.evaluator.evaluations
    return inner.best

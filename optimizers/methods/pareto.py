"""Pareto: what can be had of several objectives at once, by an evolution (NSGA-II, NSGA-III) on the batch kernels.

x dominates x' when f_i(x) <= f_i(x') for every objective i and < for one. Each point of the evolved front is then moved onto
the true one by exact slopes,

    minimise f_i(x)   subject to   f_j(x) <= f_j of the point for every j != i,   and all goals

the ends of the front by each objective alone, and every value that is shown is measured exactly.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, final

import numpy as np
from scipy.stats import qmc

from engine.parameters import Param
from engine.verdicts import Measured
from optimizers.blocks import in_blocks
from optimizers.certificate import TOLERANCE, certificate_of, number_of, worst_scenario
from optimizers.cloud import search_around
from optimizers.evaluate import UNSTABLE, Assessment, Evaluator, Matrix
from optimizers.fronts import hypervolume, knee, undominated
from optimizers.methods._base import Method, Quiet
from optimizers.problem import Across, Problem, ProblemError, Sense, Vector
from optimizers.report import conclude, unstable_advice
from optimizers.result import Front, FrontPoint, Monitor, Result, Status
from optimizers.search import SAFETY, Descent, Stopped, Tracker

_MOST_POINTS = 200
_SAMPLE = 1024
_ARCHIVE = 400
"""More undominated points than this are thinned out to half of it: each new point is compared with all."""
_WORST = 1e30
"""Stands for an objective that has no value."""
_ROUNDS, _CLOUD, _DESCENT = 12, 128, 15
"""Evaluations that move one point onto the front: rounds of a cloud of so many points, and those with slopes."""
_SPENT = "the budget of evaluations is used up: raise max_evaluations, or ask for fewer points or generations."


@final
class Pareto(Method):
    """Front of several objectives, evolved, moved onto its true place and measured exactly."""

    kind: ClassVar[str] = "pareto"
    title: ClassVar[str] = "Pareto"
    doc: ClassVar[str] = (
        "Finds the front of several objectives: points of which none is better in all. Each can be used as a start or as "
        "parameter values; the best point returned is the knee."
    )
    source: ClassVar[str] = (
        "K. Deb et al., A fast and elitist multiobjective genetic algorithm: NSGA-II, IEEE Trans. Evolutionary Computation 6 "
        "(2002) 182-197; K. Deb, H. Jain, NSGA-III, 18 (2014) 577-601; J. Blank, K. Deb, pymoo, IEEE Access 8 (2020) 89497"
    )
    options: ClassVar[tuple[Param, ...]] = (
        Param(name="points", symbol="N", unit="1", doc="points of the front, at most", default=30, lower=2, upper=_MOST_POINTS),
        Param(name="population", symbol="μ", unit="1", doc="candidates of a generation", default=128, lower=8, upper=10_000),
        Param(name="generations", symbol="", unit="1", doc="generations of the evolution", default=60, lower=1, upper=10_000),
        Param(name="seed", symbol="", unit="1", doc="makes the run repeatable", default=0, lower=0, upper=2**32 - 1),
        Param(name="max_evaluations", symbol="", unit="1", doc="evaluations of all goals in all scenarios", default=100_000, lower=0, upper=1e8),
    )  # fmt: skip

    def minimize(
        self, problem: Problem, options: Mapping[str, Any], *, rng: np.random.Generator, monitor: Monitor
    ) -> Result:
        """Return the knee of the front, and the front.

        Raises
        ------
        ProblemError
            Fewer than two objectives, or pymoo is not installed.
        """
        if importlib.util.find_spec("pymoo") is None:
            raise ProblemError(
                "pymoo must be installed for the method pareto (pip install 'servotune[pareto]'), got no such package",
                at=("method", "kind"),
            )
        if len(problem.objectives) < 2:
            raise ProblemError(
                f"goals must be at least two with a sense for the method pareto, got {len(problem.objectives)}",
                at=("goals",),
            )
        budget = int(options["max_evaluations"])
        tracker = Tracker(Evaluator(problem), monitor, budget)
        candidates = _Candidates(problem)
        status, advice = Status.CONVERGED, ""
        try:
            # Moving every point must still be affordable after the evolution.
            sweeps = len(problem.objectives) if tracker.evaluator.compiled else 0
            cost = _DESCENT + sweeps * _ROUNDS * _CLOUD
            tracker.budget = budget - min(int(options["points"]) * cost, budget // 2)
            try:
                _evolve(tracker, candidates, options, rng)
            except Stopped as stop:
                if stop.cancelled:
                    raise
                status, advice = Status.BUDGET, _SPENT
            tracker.budget = budget
            _refine(tracker, candidates, int(options["points"]), rng)
        except Stopped as stop:
            status = Status.CANCELLED if stop.cancelled else Status.BUDGET
            advice = "cancelled: this is the front until then." if stop.cancelled else _SPENT
        candidates.thin(int(options["points"]))
        monitor.progress(0.92, "measuring the front exactly")
        front = _measured(tracker.evaluator, candidates.positions)
        if front is None:
            if tracker.rank[0] >= UNSTABLE and status is Status.CONVERGED:
                status, advice = Status.INFEASIBLE, unstable_advice(problem.before)
            best = problem.start() if tracker.best is None else tracker.best
            return conclude(tracker, best, status, advice or "no point meets every goal.")
        best = _position(problem, front.points[front.knee])
        return conclude(tracker, best, status, advice or _summary(front), front=front)


class _Candidates:
    """The undominated among all points that met every goal: ``positions`` (B, V) and ``values`` (B, m), minimised."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.positions = np.empty((0, len(problem.axes)))
        self.values = np.empty((0, len(problem.objectives)))

    def minimised(self, metrics: Matrix) -> Matrix:
        """Return the objectives (B, m), smaller is better, of metric values (B, S, G) over all scenarios."""
        signs = [-1.0 if self.problem.goals[g].sense is Sense.MAXIMIZE else 1.0 for g in self.problem.objectives]
        signed = metrics[:, :, list(self.problem.objectives)] * np.array(signs)
        together = signed.mean(axis=1) if self.problem.across is Across.MEAN else signed.max(axis=1)
        return np.asarray(np.nan_to_num(together, nan=_WORST, posinf=_WORST, neginf=-_WORST))

    def offer(self, positions: Matrix, found: Assessment) -> None:
        """Take note of points; only those that meet every goal and are not dominated stay."""
        values = self.minimised(found.values)
        good = (found.violation <= TOLERANCE) & ~np.isnan(found.objective)
        positions, values = positions[good], values[good]
        fresh = ~(self.values[:, None] <= values).all(axis=2).any(axis=0)
        positions, values = positions[fresh], values[fresh]
        fresh = undominated(values)
        positions, values = positions[fresh], values[fresh]
        stay = ~(values[:, None] <= self.values).all(axis=2).any(axis=0)
        self.positions = np.vstack([self.positions[stay], positions])
        self.values = np.vstack([self.values[stay], values])
        if len(self.values) > _ARCHIVE:
            self.thin(_ARCHIVE // 2)

    def replace(self, old: Vector, position: Vector, found: Assessment) -> None:
        """Put a better point in the place of one of these; it stays where the new one breaks a goal."""
        stay = ~(self.positions == old).all(axis=1)
        if found.violation[0] <= TOLERANCE and not np.isnan(found.objective[0]):
            self.positions, self.values = self.positions[stay], self.values[stay]
            self.offer(position[None], found)

    def thin(self, count: int) -> None:
        """Keep at most ``count`` points, spread evenly: the ends, the knee, then always the one furthest from the others."""
        if len(self.values) <= count:
            return
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        places = (self.values - low) / np.where(high > low, high - low, 1.0)
        kept = list(dict.fromkeys([*self.values.argmin(axis=0).tolist(), knee(self.values)]))[:count]
        distance = np.min([np.abs(places - places[k]).max(axis=1) for k in kept], axis=0)
        while len(kept) < count:
            kept.append(int(distance.argmax()))
            distance = np.minimum(distance, np.abs(places - places[kept[-1]]).max(axis=1))
        self.positions, self.values = self.positions[kept], self.values[kept]


def _evolve(
    tracker: Tracker, candidates: _Candidates, options: Mapping[str, Any], rng: np.random.Generator
) -> None:  # fmt: skip
    """Let a population find the front; ``candidates`` takes note of every good point."""
    # Its import takes a second, and nothing else needs it.
    from pymoo.algorithms.moo.nsga2 import NSGA2  # noqa: PLC0415
    from pymoo.algorithms.moo.nsga3 import NSGA3  # noqa: PLC0415
    from pymoo.core.evaluator import Evaluator as Assigning  # noqa: PLC0415
    from pymoo.core.problem import Problem as Shape  # noqa: PLC0415
    from pymoo.problems.static import StaticProblem  # noqa: PLC0415
    from pymoo.util.ref_dirs import get_reference_directions  # noqa: PLC0415

    variables, objectives = len(candidates.problem.axes), len(candidates.problem.objectives)
    size, generations = int(options["population"]), int(options["generations"])
    seed = int(rng.integers(2**31))
    keywords = {"pop_size": size, "sampling": _sample(tracker, candidates, size, rng)}
    if objectives == 2:
        algorithm = NSGA2(**keywords)
    else:
        partitions = max(
            n for n in range(1, size) if math.comb(n + objectives - 1, objectives - 1) <= max(size, objectives)
        )
        algorithm = NSGA3(get_reference_directions("das-dennis", objectives, n_partitions=partitions), **keywords)
    shape = Shape(n_var=variables, n_obj=objectives, n_ieq_constr=1, xl=0.0, xu=1.0)
    algorithm.setup(shape, termination=("n_gen", generations), seed=seed, verbose=False)
    for generation in range(generations):
        tracker.monitor.progress(0.1 + 0.4 * generation / generations, f"generation {generation + 1} of {generations}")
        asked = algorithm.ask()
        positions = np.clip(np.asarray(asked.get("X"), dtype=float), 0.0, 1.0)
        values, violation = _assessed(tracker, candidates, positions)
        known = StaticProblem(shape, F=values, G=np.maximum(violation - TOLERANCE, 0.0)[:, None])
        Assigning().eval(known, asked)
        algorithm.tell(infills=asked)


def _assessed(tracker: Tracker, candidates: _Candidates, positions: Matrix) -> tuple[Matrix, Vector]:
    """Return the objectives, minimised, and the violation of points, and let the candidates know them."""
    values = np.empty((len(positions), len(candidates.problem.objectives)))
    violation = np.empty(len(positions))
    for rows, found in in_blocks(tracker, positions):
        candidates.offer(positions[rows], found)
        values[rows], violation[rows] = candidates.minimised(found.values), found.violation
    return values, violation


def _sample(tracker: Tracker, candidates: _Candidates, size: int, rng: np.random.Generator) -> Matrix:
    """Return the first population: of the start and a Sobol sequence the undominated, then those that break goals least."""
    tracker.monitor.progress(0.0, "sampling")
    problem = candidates.problem
    count = max(size, min(_SAMPLE, tracker.budget // 8))
    sobol = qmc.Sobol(len(problem.axes), rng=rng).random_base2(math.ceil(math.log2(count)))[: count - 1]
    positions = np.vstack([problem.start(), sobol])
    values, violation = _assessed(tracker, candidates, positions)
    rank = np.where(violation <= TOLERANCE, 0.0, violation)
    places = np.argsort(values, axis=0, kind="stable").argsort(axis=0)
    chosen = positions[np.lexsort((places.min(axis=1), rank))[:size]]
    chosen[: len(candidates.positions)] = candidates.positions[:size]
    return np.asarray(chosen)


def _refine(tracker: Tracker, candidates: _Candidates, points: int, rng: np.random.Generator) -> None:
    """Move the front onto its true place; the points that are met on the way are taken note of."""
    objectives = range(len(candidates.problem.objectives))
    if not len(candidates.positions):
        return
    if tracker.evaluator.compiled:
        # The ends first, then along the front and back again: each point begins at its refined neighbour.
        free = np.full(len(objectives), np.inf)
        for i in objectives:
            start = candidates.positions[candidates.values[:, i].argmin()]
            _search(tracker, candidates, _Aim(i, free), start, rng)
        for i in objectives:
            candidates.thin(points)
            order = np.argsort(candidates.values[:, i])
            positions, limits = candidates.positions[order], candidates.values[order]
            last = positions[0]
            for k in range(1, len(order)):
                share = (i + k / len(order)) / len(objectives)
                tracker.monitor.progress(0.5 + 0.2 * share, f"following the front, point {k + 1} of {len(order)}")
                last = _search(tracker, candidates, _Aim(i, limits[k]), last, rng)
    candidates.thin(points)
    positions, limits = candidates.positions.copy(), candidates.values.copy()
    for k in range(len(positions)):
        tracker.monitor.progress(0.7 + 0.2 * k / len(positions), f"polishing point {k + 1} of {len(positions)}")
        polished = _descend(tracker, candidates, _Aim(k % len(objectives), limits[k]), positions[k])
        if polished is not None:
            candidates.replace(positions[k], polished, tracker.assess(polished[None]))


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


def _search(tracker: Tracker, candidates: _Candidates, aim: _Aim, start: Vector, rng: np.random.Generator) -> Vector:
    """Return the best point for an aim around ``start``, found without slopes."""

    def ranking(positions: Matrix, found: Assessment) -> tuple[Vector, Vector]:
        candidates.offer(positions, found)
        values = candidates.minimised(found.values)
        return np.maximum(found.violation, aim.excess(values)), values[:, aim.lead]

    return search_around(tracker, start, rng, rounds=_ROUNDS, size=_CLOUD, ranking=ranking)


def _descend(tracker: Tracker, candidates: _Candidates, aim: _Aim, start: Vector) -> Vector | None:
    """Return a point improved for an aim by slopes."""
    alone = aim.problem(candidates.problem)
    inner = Tracker(Evaluator(alone), Quiet(tracker.monitor), tracker.budget - tracker.evaluator.evaluations)
    try:
        Descent(inner, np.full(len(alone.goals), SAFETY)).run(start, evaluations=_DESCENT)
    finally:
        tracker.evaluator.evaluations += inner.evaluator.evaluations
    return inner.best


def _measured(evaluator: Evaluator, positions: Matrix) -> Front | None:
    """Return the front of the points that meet every goal exactly, by its first objective; None if none does."""
    problem = evaluator.problem
    points, numbers = [], []
    for position in positions:
        variables = problem.values(position)
        rows = [[measured for measured, _ in row] for row in evaluator.exact(variables)]
        if not certificate_of(problem, rows).valid:
            continue
        values = tuple(_worst(problem, g, [row[g] for row in rows]) for g in range(len(problem.goals)))
        signs = [-1.0 if problem.goals[g].sense is Sense.MAXIMIZE else 1.0 for g in problem.objectives]
        objective = [sign * number_of(values[g]) for g, sign in zip(problem.objectives, signs, strict=True)]
        if np.isfinite(objective).all():
            points.append(FrontPoint(variables=variables, values=values))
            numbers.append(objective)
    if not points:
        return None
    table = np.array(numbers)
    stay = np.flatnonzero(undominated(table))
    stay = stay[np.argsort(table[stay, 0])]
    table = table[stay]
    signs = [-1.0 if problem.goals[g].sense is Sense.MAXIMIZE else 1.0 for g in problem.objectives]
    return Front(
        points=tuple(points[k] for k in stay),
        hypervolume=hypervolume(table),
        knee=knee(table),
        ideal=tuple(float(x) for x in table.min(axis=0) * signs),
        nadir=tuple(float(x) for x in table.max(axis=0) * signs),
    )


def _worst(problem: Problem, goal: int, measured: list[Measured]) -> Measured:
    return measured[worst_scenario(problem.goals[goal], measured)]


def _position(problem: Problem, point: FrontPoint) -> Vector:
    return np.array([axis.position(point.variables[axis.parameter]) for axis in problem.axes])


def _summary(front: Front) -> str:
    if len(front.points) == 1:
        return "one point is best in every objective: they do not fight each other."
    return (
        f"{len(front.points)} points of which none is better in every objective; the best point is the knee, where giving up "
        "one objective begins to cost most of another. Start from any of them, or use its values."
    )

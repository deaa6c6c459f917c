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
from typing import Any, ClassVar, final

import numpy as np

from engine.model.parameters import Param
from engine.model.verdicts import Measured
from optimizers.evaluation.certificate import TOLERANCE, certificate_of, worst_scenario
from optimizers.evaluation.compared import number_of
from optimizers.evaluation.evaluate import UNSTABLE, Evaluator, Matrix
from optimizers.methods._base import MAX_SECONDS, Method
from optimizers.problem import Problem, ProblemError, Sense, Vector
from optimizers.search.blocks import in_blocks
from optimizers.search.candidates import Candidates, packed, unpacked
from optimizers.search.front_refinement import CLOUD, DESCENT, ROUNDS, Refinement
from optimizers.search.fronts import hypervolume, knee, undominated
from optimizers.search.report import conclude, unstable_advice
from optimizers.search.result import Front, FrontPoint, Keeper, Monitor, Result, Status, kept_by
from optimizers.search.sampling_plan import sobol_sequence
from optimizers.search.search import Stopped, Tracker

_MOST_POINTS = 200
_SAMPLE = 1024
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
        MAX_SECONDS,
    )  # fmt: skip

    @classmethod
    def check(cls, problem: Problem, options: Mapping[str, Any]) -> None:  # noqa: ARG003 - of the base class
        """Refuse fewer than two objectives."""
        if len(problem.objectives) < 2:
            raise ProblemError(
                f"goals must be at least two with a sense for the method pareto, got {len(problem.objectives)}",
                at=("goals",),
            )

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
                "pymoo must be installed for the method pareto (pip install 'servotune-server[pareto]'), got no such package",
                at=("method", "kind"),
            )
        self.check(problem, options)
        budget = int(options["max_evaluations"])
        tracker = Tracker(Evaluator(problem), monitor, budget)
        candidates = Candidates(problem)
        search = _Search(tracker, candidates, rng)
        status, advice = Status.CONVERGED, ""
        try:
            # Moving every point must still be affordable after the evolution.
            sweeps = len(problem.objectives) if tracker.evaluator.compiled else 0
            cost = DESCENT + sweeps * ROUNDS * CLOUD
            tracker.budget = budget - min(int(options["points"]) * cost, budget // 2)
            try:
                search.evolve(options)
            except Stopped as stop:
                if stop.cancelled:
                    raise
                search.spent = True
            if search.spent:
                status, advice = Status.BUDGET, _SPENT
            tracker.budget = budget
            search.refine(int(options["points"]))
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


class _Search:
    """A search for a front. What an evolution was told makes it again without a single evaluation, and so goes on from there."""

    def __init__(self, tracker: Tracker, candidates: Candidates, rng: np.random.Generator) -> None:
        self._tracker, self._candidates, self._rng = tracker, candidates, rng
        #: Whether the evolution has used all that it may.
        self.spent = False
        self._seed: int | None = None
        self._first = np.empty((0, len(candidates.problem.axes)))
        self._told: list[str] = []
        self._refinement: Refinement | None = None
        kept = kept_by(tracker.monitor, Pareto.kind)
        if kept is not None:
            self._restore(kept)

    def evolve(self, options: Mapping[str, Any]) -> None:
        """Let a population find the front; the candidates take note of every good point."""
        if self._refinement is not None:
            return
        # Its import takes a second, and nothing else needs it.
        from pymoo.core.evaluator import Evaluator as Assigning  # noqa: PLC0415
        from pymoo.core.problem import Problem as Shape  # noqa: PLC0415
        from pymoo.problems.static import StaticProblem  # noqa: PLC0415

        tracker, objectives = self._tracker, len(self._candidates.problem.objectives)
        generations = int(options["generations"])
        if self._seed is None:
            self._seed = int(self._rng.integers(2**31))
            self._first = _sample(tracker, self._candidates, int(options["population"]), self._rng)
        algorithm = _algorithm(self._first, int(options["population"]), objectives)
        shape = Shape(n_var=self._first.shape[1], n_obj=objectives, n_ieq_constr=1, xl=0.0, xu=1.0)
        algorithm.setup(shape, termination=("n_gen", generations), seed=self._seed, verbose=False)
        for generation in range(generations):
            tracker.monitor.progress(
                0.1 + 0.4 * generation / generations, f"generation {generation + 1} of {generations}"
            )
            asked = algorithm.ask()
            fresh = generation == len(self._told)
            if fresh:
                positions = np.clip(np.asarray(asked.get("X"), dtype=float), 0.0, 1.0)
                values, violation = _assessed(tracker, self._candidates, positions)
                self._told.append(packed(np.column_stack([values, violation])))
            told = unpacked(self._told[generation], objectives + 1)
            excess = np.maximum(told[:, -1:] - TOLERANCE, 0.0)
            Assigning().eval(StaticProblem(shape, F=told[:, :-1], G=excess), asked)
            algorithm.tell(infills=asked)
            if fresh:
                self._keep()

    def refine(self, points: int) -> None:
        """Move the front onto its true place."""
        if self._refinement is None:
            self._refinement = Refinement()
        self._refinement.run(self._tracker, self._candidates, points, self._rng, keep=self._keep)

    def _keep(self) -> None:
        """Let a monitor that keeps states remember where the search is."""
        tracker = self._tracker
        if tracker.best is None or not isinstance(tracker.monitor, Keeper):
            return
        stage: dict[str, Any] = {"seed": self._seed, "first": packed(self._first), "told": self._told}
        if self._refinement is not None:
            stage = {"refinement": self._refinement.document()}
        tracker.monitor.keep(
            {
                "kind": Pareto.kind,
                "spent": self.spent,
                "candidates": self._candidates.document(),
                "randomness": self._rng.bit_generator.state,
                **tracker.document(),
                **stage,
            }
        )

    def _restore(self, kept: Mapping[str, Any]) -> None:
        """Be where a state says."""
        tracker, problem = self._tracker, self._candidates.problem
        self.spent = bool(kept["spent"])
        self._candidates.restore(kept["candidates"])
        self._rng.bit_generator.state = kept["randomness"]
        tracker.restore(kept)
        if "refinement" in kept:
            self._refinement = Refinement.of(kept["refinement"], problem)
        else:
            self._seed, self._told = int(kept["seed"]), list(kept["told"])
            self._first = unpacked(kept["first"], len(problem.axes))


def _algorithm(first: Matrix, size: int, objectives: int) -> Any:
    """Return the evolution that suits so many objectives, with its first population."""
    from pymoo.algorithms.moo.nsga2 import NSGA2  # noqa: PLC0415 - as above
    from pymoo.algorithms.moo.nsga3 import NSGA3  # noqa: PLC0415
    from pymoo.util.ref_dirs import get_reference_directions  # noqa: PLC0415

    if objectives == 2:
        return NSGA2(pop_size=size, sampling=first)
    partitions = max(
        n for n in range(1, size) if math.comb(n + objectives - 1, objectives - 1) <= max(size, objectives)
    )
    directions = get_reference_directions("das-dennis", objectives, n_partitions=partitions)
    return NSGA3(directions, pop_size=size, sampling=first)


def _assessed(tracker: Tracker, candidates: Candidates, positions: Matrix) -> tuple[Matrix, Vector]:
    """Return the objectives, minimised, and the violation of points, and let the candidates know them."""
    values = np.empty((len(positions), len(candidates.problem.objectives)))
    violation = np.empty(len(positions))
    for rows, found in in_blocks(tracker, positions):
        candidates.offer(positions[rows], found)
        values[rows], violation[rows] = candidates.minimised(found.values), found.violation
    return values, violation


def _sample(tracker: Tracker, candidates: Candidates, size: int, rng: np.random.Generator) -> Matrix:
    """Return the first population: of the start and a Sobol sequence the undominated, then those that break goals least."""
    tracker.monitor.progress(0.0, "sampling")
    problem = candidates.problem
    count = max(size, min(_SAMPLE, tracker.budget // 8))
    sobol = sobol_sequence(len(problem.axes), rng).random_base2(math.ceil(math.log2(count)))[: count - 1]
    positions = np.vstack([problem.start(), sobol])
    values, violation = _assessed(tracker, candidates, positions)
    rank = np.where(violation <= TOLERANCE, 0.0, violation)
    places = np.argsort(values, axis=0, kind="stable").argsort(axis=0)
    chosen = positions[np.lexsort((places.min(axis=1), rank))[:size]]
    chosen[: len(candidates.positions)] = candidates.positions[:size]
    return np.asarray(chosen)


def _measured(evaluator: Evaluator, positions: Matrix) -> Front | None:
    """Return the front of the points that meet every goal exactly, by its first objective; None if none does."""
    problem = evaluator.problem
    points, numbers = [], []
    for position in positions:
        variables = problem.values(position)
        rows = [[measured for measured, _ in row] for row in evaluator.exact.at(variables)]
        if not certificate_of(problem, rows).valid:
            continue
        values = tuple(_worst(problem, g, [row[g] for row in rows]) for g in range(len(problem.goals)))
        signs = [-1.0 if problem.goals[g].sense is Sense.MAXIMIZE else 1.0 for g in problem.objectives]
        objective = [
            sign * number_of(problem.goals[g], values[g]) for g, sign in zip(problem.objectives, signs, strict=True)
        ]
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

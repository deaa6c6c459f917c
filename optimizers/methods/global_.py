"""Global: covariance matrix adaptation (CMA-ES) on the batch kernels, restarted with growing populations, then a descent.

    x_k ~ m + σ N(0, C)

Mean m, step σ and covariance C learn from the order of the candidates alone: those that meet every goal by their objective,
then the others by their violation. So neither penalties nor jumps of a metric disturb it.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from engine.model.parameters import Param
from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.evaluate import UNSTABLE, Assessment, Evaluator, Matrix
from optimizers.methods._base import MAX_SECONDS, Method
from optimizers.problem import Problem, Vector
from optimizers.search.blocks import in_blocks
from optimizers.search.proving import descend_to_proof, polish
from optimizers.search.report import conclude, unstable_advice
from optimizers.search.result import Keeper, Monitor, Result, Status, kept_by
from optimizers.search.sampling_plan import sobol_sequence
from optimizers.search.search import SAFETY, Descent, Stopped, Tracker

_SAMPLE = 1024
_STEP = 0.2
"""First step of a run, as a part of the range of each variable."""
_FINE = 1e-5
"""A run has converged when it steps no wider than this."""
_PATIENCE = 30
"""Generations without a better point after which a run ends, and as many for each variable over ten."""
_POLISH = 200
"""Evaluations that are kept for the descent and the proof at the end."""
_SAME = 1e-2
"""Two runs have found the same optimum when their objectives differ by less."""
Places = NDArray[np.uint32]
"""From the best candidate, 0, to the worst."""
_SPENT = "the budget of evaluations is used up: raise max_evaluations, or take fewer restarts."


@final
class Global(Method):
    """Covariance matrix adaptation with restarts, polished by exact derivatives."""

    kind: ClassVar[str] = "global"
    title: ClassVar[str] = "Global"
    doc: ClassVar[str] = (
        "Evolves a population over the whole range (CMA-ES), several times with larger populations; for objectives with "
        "jumps or many local optima. The best point is polished by a descent and proven."
    )
    source: ClassVar[str] = (
        "N. Hansen, The CMA evolution strategy: a tutorial, arXiv:1604.00772; A. Auger, N. Hansen, A restart CMA evolution "
        "strategy with increasing population size, CEC 2005, pp. 1769-1776"
    )
    options: ClassVar[tuple[Param, ...]] = (
        Param(name="population", symbol="λ", unit="1", doc="candidates of a generation in the first run; 0 takes 8 + 6 ln V, at least 32", default=0, lower=0, upper=10_000),
        Param(name="restarts", symbol="", unit="1", doc="further runs, each with twice the population", default=3, lower=0, upper=20),
        Param(name="seed", symbol="", unit="1", doc="makes the run repeatable", default=0, lower=0, upper=2**32 - 1),
        Param(name="max_evaluations", symbol="", unit="1", doc="evaluations of all goals in all scenarios", default=30_000, lower=0, upper=1e8),
        MAX_SECONDS,
    )  # fmt: skip

    def minimize(
        self, problem: Problem, options: Mapping[str, Any], *, rng: np.random.Generator, monitor: Monitor
    ) -> Result:
        """Return the best point found; go on from where a monitor that keeps states says."""
        budget = int(options["max_evaluations"])
        tracker = Tracker(Evaluator(problem), monitor, budget)
        margins = np.full(len(problem.goals), SAFETY)
        ends: list[tuple[float, float]] = []
        status, advice = Status.CONVERGED, ""
        try:
            tracker.budget = budget - min(_POLISH, budget // 4)
            try:
                _explore(tracker, options, rng, ends)
                advice = _agreement(ends)
            except Stopped as stop:
                if stop.cancelled or tracker.best is None:
                    raise
                status, advice = Status.BUDGET, _SPENT
            tracker.budget = budget
            assert tracker.best is not None
            tracker.stage(0.9, 0.95, "polishing", evaluations=_POLISH)
            Descent(tracker, margins).run(tracker.best, evaluations=_POLISH // 3)
            polish(tracker, margins, evaluations=_POLISH // 3)
            descend_to_proof(tracker, margins)
        except Stopped as stop:
            status = Status.CANCELLED if stop.cancelled else Status.BUDGET
            advice = "cancelled: this is the best point until then." if stop.cancelled else _SPENT
        if tracker.rank[0] >= UNSTABLE and status is Status.CONVERGED:
            status, advice = Status.INFEASIBLE, unstable_advice(problem.before)
        monitor.progress(0.95, "proving the optimum")
        best = problem.start() if tracker.best is None else tracker.best
        return conclude(tracker, best, status, advice)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Told:
    """What an evolution was told of one generation: the places of its candidates, and the rank of the best of them."""

    places: Places
    leader: tuple[float, float]


@dataclass(kw_only=True, eq=False)
class _Run:
    """An evolution from its start: its randomness and what it was told make it again without a single evaluation."""

    number: int
    size: int
    start: Vector
    randomness: Mapping[str, Any]
    told: list[_Told] = field(default_factory=list)

    def document(self, tracker: Tracker, ends: list[tuple[float, float]]) -> dict[str, Any]:
        """Return the search as it is now, in plain numbers."""
        return {
            "kind": "global",
            "run": self.number,
            "size": self.size,
            "start": self.start.tolist(),
            "randomness": self.randomness,
            "told": [[base64.b64encode(told.places.tobytes()).decode(), *_plain(told.leader)] for told in self.told],
            "ends": [_plain(end) for end in ends],
            **tracker.document(),
        }

    @staticmethod
    def of(state: Mapping[str, Any], tracker: Tracker, ends: list[tuple[float, float]]) -> _Run:
        """Return the evolution that a state describes; the tracker and ``ends`` are as they were then."""
        tracker.restore(state)
        ends += [_rank(*end) for end in state["ends"]]
        return _Run(
            number=int(state["run"]),
            size=int(state["size"]),
            start=np.array(state["start"], dtype=float),
            randomness=state["randomness"],
            told=[
                _Told(places=np.frombuffer(base64.b64decode(places), dtype=np.uint32), leader=_rank(*leader))
                for places, *leader in state["told"]
            ],
        )


def _plain(rank: tuple[float, float]) -> list[float | None]:
    return [number if math.isfinite(number) else None for number in rank]


def _rank(violation: float | None, objective: float | None) -> tuple[float, float]:
    return math.inf if violation is None else violation, math.inf if objective is None else objective


def _explore(
    tracker: Tracker, options: Mapping[str, Any], rng: np.random.Generator, ends: list[tuple[float, float]]
) -> None:
    """Run all evolutions; ``ends`` takes the best rank of each. Go on from where a monitor that keeps states says."""
    variables = len(tracker.evaluator.problem.axes)
    kept = kept_by(tracker.monitor, "global")
    if kept is None:
        first = _sample(tracker, rng)
        size = int(options["population"]) or max(32, int(8 + 6 * math.log(variables)))
        run = _Run(number=0, size=size, start=first, randomness=rng.bit_generator.state)
    else:
        run = _Run.of(kept, tracker, ends)
        rng.bit_generator.state = run.randomness
    runs = 1 + int(options["restarts"])
    while True:
        share = 0.1 + 0.8 * run.number / runs
        tracker.monitor.progress(share, f"run {run.number + 1} of {runs}, population {run.size}")
        ends.append(_evolve(tracker, run, rng, (share, 0.8 / runs), ends))
        if run.number + 1 == runs:
            return
        start = rng.random(variables)
        run = _Run(number=run.number + 1, size=2 * run.size, start=start, randomness=rng.bit_generator.state)


def _sample(tracker: Tracker, rng: np.random.Generator) -> Vector:
    """Return the best of the start and a Sobol sequence."""
    problem = tracker.evaluator.problem
    count = min(_SAMPLE, max(1, tracker.budget // 8))
    tracker.monitor.progress(0.0, "sampling")
    sobol = sobol_sequence(len(problem.axes), rng).random_base2(math.ceil(math.log2(count)))[: count - 1]
    for _ in in_blocks(tracker, np.vstack([problem.start(), sobol]), roughly=True):
        pass
    assert tracker.best is not None
    return tracker.best


def _evolve(
    tracker: Tracker, run: _Run, rng: np.random.Generator, share: tuple[float, float], ends: list[tuple[float, float]]
) -> tuple[float, float]:
    """Run one evolution; return the rank (violation, objective) of the best point that it met."""
    import cma  # noqa: PLC0415 - its import takes a second, and nothing else needs it

    start, size = run.start, run.size
    variables = len(start)
    patience = _PATIENCE + _PATIENCE * variables // 10
    # The strategy needs two coordinates; a second one that means nothing does no harm.
    strategy = cma.CMAEvolutionStrategy(
        start.tolist() if variables > 1 else [float(start[0]), 0.5], _STEP,
        {
            "bounds": [0.0, 1.0], "popsize": size, "seed": np.nan, "verbose": -10,
            "randn": lambda *shape: rng.standard_normal(shape),
        },
    )  # fmt: skip
    best = (math.inf, math.inf)
    waited, generation, steps, done = 0, 0, _STEP, 0.0
    narrowed = False
    while waited < patience and steps > _FINE and not narrowed:
        asked = strategy.ask()
        fresh = generation == len(run.told)
        if fresh:
            run.told.append(_compared(tracker, np.clip(np.array(asked)[:, :variables], 0.0, 1.0)))
        told = run.told[generation]
        try:
            strategy.tell(asked, told.places.tolist())
        except RuntimeError:  # rounding has left one of its variances below 0: it comes no nearer
            narrowed = True
        waited = 0 if told.leader < best else waited + 1
        best = min(best, told.leader)
        generation += 1
        if fresh and isinstance(tracker.monitor, Keeper):
            tracker.monitor.keep(run.document(tracker, ends))
        steps = float(strategy.sigma) * float(np.maximum(strategy.sm.variances[:variables], 0.0).max() ** 0.5)
        # Steps shrink by orders of magnitude at a steady rate: the measure of how far the run has come. It never goes back,
        # though a step grows now and then and a better point ends the waiting.
        done = max(done, math.log(_STEP / max(steps, _FINE)) / math.log(_STEP / _FINE), waited / patience)
        tracker.monitor.progress(share[0] + share[1] * min(done, 1.0), f"generation {generation} of {size}")
    return best


def _compared(tracker: Tracker, points: Matrix) -> _Told:
    """Return the places of candidates, from the best to the worst."""
    places = np.empty(len(points), dtype=np.uint32)
    found: list[Assessment] = [block for _, block in in_blocks(tracker, points)]
    ranks = _ranks(found)
    order = np.lexsort((ranks[:, 1], ranks[:, 0]))
    places[order] = np.arange(len(points))
    return _Told(places=places, leader=(float(ranks[order[0], 0]), float(ranks[order[0], 1])))


def _ranks(blocks: list[Assessment]) -> Matrix:
    """Return (violation, objective) of each point, as it counts in the order."""
    violation = np.concatenate([block.violation for block in blocks])
    objective = np.concatenate([block.objective for block in blocks])
    return np.stack(
        [np.where(violation <= TOLERANCE, 0.0, violation), np.where(np.isnan(objective), np.inf, objective)], axis=1
    )


def _agreement(ends: list[tuple[float, float]]) -> str:
    """Return how many runs found the same optimum."""
    best = min(ends)
    same = sum(end[0] == best[0] == 0 and abs(end[1] - best[1]) <= _SAME * abs(best[1]) for end in ends)
    if len(ends) == 1:
        return "one run converged here; restarts would show whether another optimum is better."
    if same < 2:
        return f"one of {len(ends)} runs found this optimum, the others worse ones: raise restarts to be surer."
    return f"{same} of {len(ends)} runs ended here, from different places."

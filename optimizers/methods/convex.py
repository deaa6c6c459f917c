"""Convex: a controller that is linear in its parameters, by the convex-concave procedure from several stable starts.

    minimise f(x)   subject to   |N(jω; x)| ≤ m(ω) |D(jω; x)|   for all ω,   N and D linear in x

The bounds hold on the continuous frequency axis: where the exact response peaks between frequencies, these are added. A loop
that is stable at the start stays stable. Where the problem is of another form, it is refused with the reason.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, final

import numpy as np

from engine.model.parameters import Param
from optimizers.convex.convex_concave import Procedure
from optimizers.convex.linear_controller import LinearLoop, linear_loops
from optimizers.convex.placement import Placement, structure_of
from optimizers.convex.point import Point
from optimizers.convex.ratios import INTEGRATED_ERROR, ratios_of
from optimizers.convex.youla import best_linear
from optimizers.evaluation.evaluate import Evaluator
from optimizers.methods._base import MAX_SECONDS, Method
from optimizers.problem import Problem, ProblemError, Vector
from optimizers.search.report import conclude, unstable_advice
from optimizers.search.result import Monitor, Result, Status
from optimizers.search.sampling_plan import sobol_sequence
from optimizers.search.search import SAFETY, Descent, Stopped, Tracker

_SAMPLE = 128
_APART = 0.1
_BUDGET = 1_000_000
_POLISH = 200
_SAME = 1e-3
"""Two starts have led to the same optimum when their objectives differ by less, relative to them."""


@final
class Convex(Method):
    """Convex-concave optimisation of a controller that is linear in its parameters."""

    kind: ClassVar[str] = "convex"
    title: ClassVar[str] = "Convex"
    doc: ClassVar[str] = (
        "For controllers that are linear in their parameters (PI, PID, PD₂, gains in parallel): peaks and bounds of |S|, |T|, "
        "|KS| and of any path, and the integrated error, held and minimised at every frequency by convex programming."
    )
    source: ClassVar[str] = (
        "M. Hast, K. J. Åström, B. Bernhardsson, S. Boyd, PID design by convex-concave optimization, European Control "
        "Conference 2013, pp. 4460-4465"
    )
    options: ClassVar[tuple[Param, ...]] = (
        Param(name="starts", symbol="k", unit="1", doc="stable points to start from", default=3, lower=1, upper=100),
        Param(
            name="limit",
            symbol="",
            unit="1",
            shape="text",
            default="none",
            choices=("none", "linear"),
            doc="linear: also a bound that no linear controller can beat, of whatever order, in the place of this one",
        ),
        Param(name="seed", symbol="", unit="1", doc="makes the run repeatable", default=0, lower=0, upper=2**32 - 1),
        MAX_SECONDS,
    )

    def minimize(
        self, problem: Problem, options: Mapping[str, Any], *, rng: np.random.Generator, monitor: Monitor
    ) -> Result:
        """Return the best point found.

        Raises
        ------
        ProblemError
            Where the problem is not of the form that this method solves, or its solvers are not installed.
        """
        if importlib.util.find_spec("cvxpy") is None:
            raise ProblemError(
                "cvxpy must be installed for the method convex (pip install 'servotune-server[convex]'), got no such package",
                at=("method", "kind"),
            )
        tracker = Tracker(Evaluator(problem), monitor, _BUDGET)

        def watch(point: Point) -> None:
            if monitor.cancelled():
                raise Stopped(cancelled=True)
            tracker.evaluator.evaluations += len(problem.scenarios)
            if point.stable:
                tracker.offer(_position(problem, point.x), point.objective, point.violation)

        monitor.progress(0.0, "looking for what is linear in the variables")
        loops, procedure = _procedure(problem, tracker.evaluator, watch)
        ends: list[tuple[Point, str]] = []
        status, advice = Status.CONVERGED, ""
        try:
            wanted = int(options["starts"])
            for number, start in enumerate(_starts(problem, procedure, wanted, rng)):
                monitor.progress(0.1 + 0.8 * number / wanted, f"convex programs from start {number + 1} of {wanted}")
                end = procedure.run(start)
                ends.append(_finished(end, procedure, tracker) if isinstance(procedure, Placement) else end)
        except Stopped:
            status, advice = Status.CANCELLED, "cancelled: this is the best point until then."
        if status is not Status.CANCELLED:
            status, advice = _outcome(ends, problem)
        bound = None
        if status is Status.CONVERGED and options["limit"] == "linear" and loops:
            monitor.progress(0.9, "how far any linear controller can go")
            bound = best_linear(problem, loops, min((point for point, _ in ends), key=lambda point: point.rank).x)
            advice = f"{advice} {_compared(problem, bound)}"
        monitor.progress(0.95, "proving the optimum")
        best = problem.start() if tracker.best is None else tracker.best
        if ends:  # what came by on the way may lie beyond the bounds by what the certificate tolerates
            best = _position(problem, min((point for point, _ in ends), key=lambda point: point.rank).x)
        return conclude(tracker, best, status, advice, bound=bound)


def _procedure(
    problem: Problem, evaluator: Evaluator, watch: Callable[[Point], None]
) -> tuple[tuple[LinearLoop, ...], Procedure | Placement]:
    """Return the loops that are linear in the variables with their procedure, or none and that of a structure."""
    try:
        loops = linear_loops(problem, ratios_of(problem))
    except ProblemError:
        paths = structure_of(problem)
        if paths is None:
            raise
        return (), Placement(evaluator, paths, watch)
    return loops, Procedure(evaluator, loops, watch)


def _finished(end: tuple[Point, str], placement: Placement, tracker: Tracker) -> tuple[Point, str]:
    """Return where a descent along the exact slopes leads from the end of a placement."""
    point, why = end
    if not point.stable:
        return end
    margins = np.full(len(tracker.evaluator.problem.goals), SAFETY)
    Descent(tracker, margins).run(_position(tracker.evaluator.problem, point.x), evaluations=_POLISH)
    assert tracker.best is not None
    values = tracker.evaluator.problem.values(tracker.best)
    last = placement.look(np.array([values[axis.parameter] for axis in tracker.evaluator.problem.axes]))
    return (last, "") if last.rank <= point.rank else (point, why)


def _compared(problem: Problem, bound: float | None) -> str:
    if bound is not None:
        return f"No linear controller in its place has an objective below {bound:.4g}."
    if any(problem.goals[g].metric == INTEGRATED_ERROR for g in problem.objectives):
        return "Linear controllers have no limit here: with a second integrator the integrated error is 0."
    return "A limit for all linear controllers is known for one objective and one block with one input alone."


def _position(problem: Problem, x: Vector) -> Vector:
    return np.array([axis.position(float(value)) for axis, value in zip(problem.axes, x, strict=True)])


def _starts(
    problem: Problem, procedure: Procedure | Placement, count: int, rng: np.random.Generator
) -> Iterator[Vector]:
    """Yield stable points, the present one first if it is, then the most promising of a Sobol sequence, wide apart."""
    first = problem.start()
    sample = sobol_sequence(len(problem.axes), rng).random(_SAMPLE)
    positions = np.vstack([first, sample])
    points = np.stack([axis.value(positions[:, k]) for k, axis in enumerate(problem.axes)], axis=1)
    order = [0, *(1 + np.array(procedure.ranking(points[1:], points[0])))]
    chosen: list[Vector] = []
    for index in order:
        if all(np.abs(positions[index] - other).max() > _APART for other in chosen) and procedure.stable(points[index]):
            chosen.append(positions[index])
            yield points[index]
            if len(chosen) == count:
                return


def _outcome(ends: Sequence[tuple[Point, str]], problem: Problem) -> tuple[Status, str]:
    if not ends:
        return Status.INFEASIBLE, unstable_advice(problem.before)
    best, why = min(ends, key=lambda end: end[0].rank)
    if why:
        return Status.STALLED, f"{why}: begin from this point, or use the method gradient."
    size = max(abs(best.objective), 1e-300)
    same = sum(
        point.rank[0] == best.rank[0] and abs(point.objective - best.objective) <= _SAME * size for point, _ in ends
    )
    found = f"{same} of {len(ends)} stable starts lead to this optimum; it holds at every frequency."
    if all(goal.metric == INTEGRATED_ERROR for goal in problem.goals):
        found += " No goal bounds a peak, so it may lie near the limit of stability: bound sensitivity_peak."
    return Status.CONVERGED, found

"""Auto: looks at the problem, chooses the method that suits it, and says why."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, final

import numpy as np

from engine.model.errors import EngineError
from engine.model.parameters import Param
from optimizers import methods
from optimizers.convex.linear_controller import linear_loops
from optimizers.convex.ratios import ratios_of
from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.evaluate import Evaluator
from optimizers.methods._base import MAX_SECONDS, Method
from optimizers.problem import Problem
from optimizers.search.blocks import in_blocks
from optimizers.search.result import Monitor, Quiet, Result
from optimizers.search.sampling_plan import sobol_sequence
from optimizers.search.search import Stopped, Tracker

_SAMPLE = 1024
_RARE = 0.002
"""Share of points that meet every goal below which a descent may never find any."""
_EVERY, _EVERY_SLOW = 100_000, 2000
"""So many combinations of discrete variables are simply all evaluated, with compiled kernels and without."""


@final
class Auto(Method):
    """The method that suits the problem, and why."""

    kind: ClassVar[str] = "auto"
    title: ClassVar[str] = "Auto"
    doc: ClassVar[str] = "Looks at the problem, chooses one of the other methods and says why."
    source: ClassVar[str] = (
        "D. H. Wolpert, W. G. Macready, No free lunch theorems for optimization, IEEE Trans. Evolutionary Computation 1 "
        "(1997) 67-82"
    )
    options: ClassVar[tuple[Param, ...]] = (
        Param(name="seed", symbol="", unit="1", doc="makes the run repeatable", default=0, lower=0, upper=2**32 - 1),
        Param(name="max_evaluations", symbol="", unit="1", doc="evaluations of all goals in all scenarios; 0 leaves it to the method", default=0, lower=0, upper=1e7),
        MAX_SECONDS,
    )  # fmt: skip

    def minimize(
        self, problem: Problem, options: Mapping[str, Any], *, rng: np.random.Generator, monitor: Monitor
    ) -> Result:
        """Return what the chosen method returns; its advice begins with the choice and the reason."""
        monitor.progress(0.0, "looking at the problem")
        kind, reason = choose(problem, rng, monitor)
        known = {param.name for param in methods.catalogue()[kind].options}
        passed = {name: value for name, value in options.items() if name in known and (name == "seed" or value)}
        if kind == "grid":
            passed["points"] = {axis.parameter: len(axis.levels) for axis in problem.axes}
        monitor.progress(0.0, f"{kind}: {reason}")
        result = methods.minimize(kind, problem, passed, monitor=monitor)
        return replace(
            result, advice=f"{kind} was chosen because {reason}. {result.advice[:1].upper()}{result.advice[1:]}"
        )


def choose(problem: Problem, rng: np.random.Generator, monitor: Monitor) -> tuple[str, str]:
    """Return the kind of method that suits a problem, and why.

    Parameters
    ----------
    problem : Problem
    rng : numpy.random.Generator
        Draws the points of a first look.
    monitor : Monitor
        May cancel the first look.
    """
    objectives = problem.objectives
    if len(objectives) > 1 and len({problem.goals[g].weight for g in objectives}) == 1:
        return "pareto", f"there are {len(objectives)} objectives and no weights that would make them one"
    evaluator = Evaluator(problem)
    if all(axis.discrete for axis in problem.axes):
        combinations = math.prod(len(axis.levels) for axis in problem.axes)
        if combinations <= (_EVERY if evaluator.compiled else _EVERY_SLOW):
            return "grid", f"all variables are discrete, and their {combinations} combinations can all be evaluated"
    if _is_convex(problem):
        return (
            "convex",
            "the controller is linear in the variables and every goal is a magnitude of its loop or an integrated error",
        )
    if not evaluator.compiled:
        return "gradient", "a candidate takes long to evaluate, and exact slopes need the fewest"
    share = _share(evaluator, rng, monitor)
    if share < _RARE:
        return (
            "global",
            f"of a first look at {_SAMPLE} points {share:.1%} meet every goal: no descent would begin near one",
        )
    return "gradient", f"its goals have exact slopes, and {share:.0%} of a first look at {_SAMPLE} points meet them"


def _is_convex(problem: Problem) -> bool:
    if importlib.util.find_spec("cvxpy") is None or any(axis.discrete for axis in problem.axes):
        return False
    try:
        linear_loops(problem, ratios_of(problem))
    except EngineError:
        return False
    return True


def _share(evaluator: Evaluator, rng: np.random.Generator, monitor: Monitor) -> float:
    """Return the share of a Sobol sample that meets every goal."""
    points = sobol_sequence(len(evaluator.problem.axes), rng).random(_SAMPLE)
    tracker = Tracker(evaluator, Quiet(monitor), budget=10 * _SAMPLE)
    met = 0
    try:
        for _, found in in_blocks(tracker, points, roughly=True):
            met += int(((found.violation <= TOLERANCE) & ~np.isnan(found.objective)).sum())
    except Stopped:
        return 0.0  # cancelled: so will be the method that is chosen
    return met / _SAMPLE

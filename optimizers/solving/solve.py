"""The way from a problem to a result: its method, and around it what no method knows of.

Ranges of uncertain parameters become scenarios, discrete variables are settled, other methods check the optimum, the yield is
estimated; problems that differ in their structure are compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from engine.metrics import catalogue as metric_catalogue
from engine.model.errors import EngineError, IllPosedError, Path
from engine.model.verdicts import Verdict
from optimizers import methods
from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.compared import numbers_of
from optimizers.evaluation.effort import metered, seconds_of
from optimizers.evaluation.evaluate import Evaluator
from optimizers.evaluation.measuring import measured
from optimizers.problem import Problem, ProblemError
from optimizers.search.limits import Limited
from optimizers.search.result import Gap, Monitor, Result, Share, Unwatched
from optimizers.solving.expectation import expected
from optimizers.solving.moved import with_moves
from optimizers.solving.neighbours import settle
from optimizers.solving.robust import solve_robust

MOST_SAMPLES = 100_000


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Problems that differ in their structure, each solved; ``best`` is the name of the one whose result is the best."""

    best: str
    results: Mapping[str, Result]
    objectives: Mapping[str, float]
    """Of each, with the sizes of the first one's goals before, so that they compare; NaN where a metric has no value."""


def check_applicable(problem: Problem) -> None:
    """Refuse scenarios that the system refuses, and goals whose metric does not exist under their experiment.

    Raises
    ------
    ProblemError
        With the scenario or range and what is wrong with it, or the goal and what it needs.
    """
    start = {path: v for path, v in problem.values(problem.start()).items() if path not in problem.commands}
    for index, scenario in enumerate(problem.scenarios):
        _check_exists(problem, {**start, **scenario}, problem.scenario_place(index))
    for index, axis in enumerate(problem.ranges):
        for key, end in (("lower", axis.lower), ("upper", axis.upper)):
            _check_exists(problem, {**start, axis.parameter: end}, ("uncertain", index, key))
    if problem.diagram.nonlinear:  # a simulation each, and what is absent at the start may be there elsewhere
        return
    catalogue = metric_catalogue()
    timed = [g for g, goal in enumerate(problem.goals) if catalogue[goal.metric].domain == "time"]
    found = measured(problem, problem.values(problem.start()), problem.scenarios[0], goals=timed)
    for g, (one, _) in zip(timed, found, strict=True):
        if one.verdict is Verdict.NOT_APPLICABLE:
            goal = problem.goals[g]
            raise ProblemError(
                f"metric must be one that exists under experiment {goal.experiment!r}, got {goal.metric}: {one.advice}",
                at=("goals", g, "metric"),
            )


def _check_exists(problem: Problem, overrides: Mapping[str, float], at: Path) -> None:
    try:
        problem.diagram.realize(overrides)
    except IllPosedError:  # at the start only, maybe
        return
    except EngineError as error:
        raise ProblemError(error.message, at=at) from error


def solve(
    kind: str,
    problem: Problem,
    options: Mapping[str, Any] | None = None,
    *,
    monitor: Monitor | None = None,
    checks: Sequence[str] = (),
    samples: int = 0,
    seconds: float | None = None,
) -> Result:
    """Solve a problem with everything around it.

    Parameters
    ----------
    kind : str
        Of the method.
    problem : Problem
    options : mapping, optional
        The method's.
    monitor : Monitor, optional
    checks : sequence of str
        Kinds of methods that solve the same problem with their defaults, to show how far apart they end.
    samples : int
        Draws of the uncertain parameters for the yield; 0 for none.
    seconds : float, optional
        How long it may take; the search ends before, and its best point until then is the result.

    Raises
    ------
    ProblemError
        An unknown method or option, a goal that does not exist under its experiment, a yield without uncertain parameters.
    """
    with metered() as effort:
        watch = Limited(monitor or Unwatched(), _time_of(options, seconds))
        with effort.limited(watch.hardly_left):
            result = _whole(kind, problem, options, watch, checks=checks, samples=samples)
        spent = effort.spent()
        return replace(result, seconds=seconds_of(spent), effort=spent)


def _whole(
    kind: str,
    problem: Problem,
    options: Mapping[str, Any] | None,
    watch: Limited,
    *,
    checks: Sequence[str],
    samples: int,
) -> Result:
    check_applicable(problem)
    check_request(problem, checks=checks, samples=samples)
    parts = 1 + len(checks)
    result = watch.told(_solved(kind, problem, options or {}, Share(watch, 0.0, 0.9 / parts)))
    result = with_moves(problem, result, watch.ended)
    if checks and not watch.cancelled():
        gaps = []
        for number, other in enumerate(checks, start=1):
            found = watch.told(_solved(other, problem, {}, Share(watch, 0.9 * number / parts, 0.9 / parts)))
            gaps.append(_gap(other, result, found))
        result = replace(result, gaps=tuple(gaps))
    if samples and not watch.cancelled():
        watch.progress(0.95, "estimating the yield")
        found_yield = expected(
            problem, result.best, samples=samples, rng=yield_randomness(options), monitor=Share(watch, 0.95, 0.05)
        )
        result = replace(result, expected=found_yield)
    return result


def yield_randomness(options: Mapping[str, Any] | None) -> np.random.Generator:
    """Return what the draws of the yield come from: the seed of the method, 0 where it has none."""
    return np.random.default_rng(int((options or {}).get("seed", 0) or 0))


def check_request(problem: Problem, *, checks: Sequence[str], samples: int) -> None:
    """Refuse cross-checks and yields that cannot be had.

    Raises
    ------
    ProblemError
    """
    for index, other in enumerate(checks):
        if other not in methods.catalogue():
            raise ProblemError(
                f"cross_check must name methods ({', '.join(methods.catalogue())}), got {other!r}",
                at=("cross_check", index),
            )
    if samples and not problem.uncertain:
        raise ProblemError(
            "yield_samples must be left out without uncertain parameters, got some", at=("yield_samples",)
        )
    if not 0 <= samples <= MOST_SAMPLES:
        raise ProblemError(f"yield_samples must be within 0 … {MOST_SAMPLES}, got {samples}", at=("yield_samples",))


def compare(
    kind: str,
    problems: Mapping[str, Problem],
    options: Mapping[str, Any] | None = None,
    *,
    monitor: Monitor | None = None,
    checks: Sequence[str] = (),
    samples: int = 0,
    seconds: float | None = None,
) -> Comparison:
    """Solve problems that differ in their structure, with the same goals, and say which is the best.

    One that serves every goal is better than one that does not; of those that do, the objective decides.

    Raises
    ------
    ProblemError
        As :func:`solve`; fewer than two problems, or goals that differ.
    """
    if len(problems) < 2:
        raise ProblemError(f"alternatives must be at least two systems, got {len(problems)}", at=("alternatives",))
    watch = Limited(monitor or Unwatched(), seconds)
    first, *_ = problems.values()
    results: dict[str, Result] = {}
    for number, (name, problem) in enumerate(problems.items()):
        share = Share(watch, number / len(problems), 1 / len(problems))
        share.progress(0.0, f"{name}: {number + 1} of {len(problems)}")
        results[name] = watch.told(solve(kind, problem, options, monitor=share, checks=checks, samples=samples))
    scale = Evaluator(first)
    objectives = {name: _comparable(scale, result) for name, result in results.items()}

    def badness(name: str) -> tuple[float, float]:
        violation, objective = results[name].certificate.worst_violation, objectives[name]
        return violation if violation > TOLERANCE else 0.0, np.inf if np.isnan(objective) else objective

    return Comparison(best=min(results, key=badness), results=results, objectives=objectives)


def _comparable(scale: Evaluator, result: Result) -> float:
    """Return the objective of a result from its goals in their worst scenarios, on the scale of the first problem."""
    values = numbers_of(scale.problem.goals, [[report.after for report in result.goals]])
    wanted = [g for g in scale.problem.objectives if np.isnan(values[0, g])]
    return float("nan") if wanted else float(scale.objectives(np.nan_to_num(values)).max())


def _time_of(options: Mapping[str, Any] | None, seconds: float | None) -> float | None:
    """Return the shorter of the time that the caller gives and the ``max_seconds`` of the method; None without either."""
    own = (options or {}).get("max_seconds") or None
    return min((limit for limit in (own, seconds) if limit is not None), default=None)


def _solved(kind: str, problem: Problem, options: Mapping[str, Any], monitor: Monitor) -> Result:
    """Solve by one method, ranges made scenarios and discrete variables settled."""

    def minimize(plain: Problem, share: Monitor) -> Result:
        return settle(plain, methods.minimize(kind, plain, options, monitor=share), share)

    return solve_robust(problem, minimize, monitor) if problem.uncertain else minimize(problem, monitor)


def _gap(kind: str, result: Result, other: Result) -> Gap:
    size = abs(result.objective) or 1.0
    return Gap(
        method=kind, status=other.status, objective=other.objective, violation=other.certificate.worst_violation,
        gap=(other.objective - result.objective) / size, best=other.best,
    )  # fmt: skip

"""The goals of a problem as exact measurements at given values of its variables, whether of the system or of commands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.analysis.commanded import CommandParameter
from engine.analysis.study import Gradient, MetricRequest, measure, unit_of
from engine.model.errors import DiagramError, ExpressionError, SignalError, UnresolvedError
from engine.model.verdicts import Measured, Verdict
from optimizers.problem.ties import resolved

if TYPE_CHECKING:
    from optimizers.problem import Experiment, Problem, Scenario

_STEP = 1e-30


def measured(
    problem: Problem,
    values: Mapping[str, float],
    scenario: Scenario,
    *,
    goals: Sequence[int] | None = None,
    gradient: bool = False,
    tied: bool = True,
) -> list[tuple[Measured, Gradient | None]]:
    """Return the metrics of goals on the exact path, with their derivatives by the variables where asked for.

    Parameters
    ----------
    problem : Problem
    values : mapping of str to float
        The variables, SI.
    scenario : mapping of str to float
        Parameters of the system, SI.
    goals : sequence of int, optional
        Which goals; all by default.
    gradient : bool
        Derivatives by the variables, in the order of the problem's axes.
    tied : bool
        Whether tied variables have the values that their expressions give them, whatever ``values`` says.
    """
    chosen = range(len(problem.goals)) if goals is None else goals
    bound = problem.tied({axis.parameter: values[axis.parameter] for axis in problem.axes}, scenario) if tied else {}
    if any(math.isnan(value) for value in bound.values()):
        return [(_refused(problem, goal, "a tied variable has no value here"), None) for goal in chosen]
    overrides = {path: value for path, value in {**scenario, **values, **bound}.items() if path not in problem.commands}
    try:
        experiments = {experiment.name: experiment for experiment in problem.experiments_at(values)}
    except SignalError as error:  # numbers that are each within their bounds, but not together
        return [(_refused(problem, goal, error.message), None) for goal in chosen]
    requests = [_request_at(problem, goal, experiments) for goal in chosen]
    lanes = [_lane(problem, axis.parameter, experiments) for axis in problem.axes] if gradient else []
    try:
        found = measure(problem.diagram, requests, overrides=overrides, gradient=[*lanes, *(bound if gradient else ())])
    except (
        DiagramError,
        ExpressionError,
        UnresolvedError,
    ) as error:  # a block, or a number, does not exist at these values
        return [(_refused(problem, goal, error.message), None) for goal in chosen]
    if not (gradient and bound):
        return found
    moves = _moves(problem, values, scenario)
    return [(one, None if slopes is None else _folded(slopes, moves)) for one, slopes in found]


def _moves(problem: Problem, values: Mapping[str, float], scenario: Scenario) -> npt.NDArray[np.float64]:
    """Return the derivatives of the tied variables by the free ones, (T, V)."""
    free = {axis.parameter: values[axis.parameter] for axis in problem.axes}
    columns = []
    for axis in problem.axes:
        lane = {**scenario, **free, axis.parameter: free[axis.parameter] + _STEP * 1j}
        found = resolved(problem.ties, lane, problem.own_value)
        columns.append([float(np.imag(np.asarray(found[name]))) / _STEP for name in problem.ties])
    return np.array(columns).T


def _folded(slopes: Gradient, moves: npt.NDArray[np.float64]) -> Gradient:
    """Return the derivatives by the free variables alone, what they move through the tied ones included."""
    free = moves.shape[1]
    return Gradient(values=slopes.values[:free] + slopes.values[free:] @ moves, one_sided=slopes.one_sided)


def screened(problem: Problem) -> tuple[MetricRequest, ...]:
    """Return the requests as the screening sees them: a command that varies is left to the exact path."""
    varied = {place.experiment for place in problem.commands.values()}
    return tuple(
        replace(request, signals={}) if goal.experiment in varied else request
        for goal, request in zip(problem.goals, problem.requests, strict=True)
    )


def _request_at(problem: Problem, goal: int, experiments: Mapping[str, Experiment]) -> MetricRequest:
    request, name = problem.requests[goal], problem.goals[goal].experiment
    return replace(request, signals=experiments[name].signals) if request.signals and name else request


def _lane(problem: Problem, path: str, experiments: Mapping[str, Experiment]) -> str | CommandParameter:
    place = problem.commands.get(path)
    if place is None:
        return path
    return CommandParameter(signal=experiments[place.experiment].signals[place.port], path=place.parameter)


def _refused(problem: Problem, goal: int, advice: str) -> Measured:
    unit = unit_of(problem.diagram, problem.requests[goal])
    return Measured(value=None, unit=unit, verdict=Verdict.ILL_POSED, advice=advice)

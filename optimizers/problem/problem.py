"""An optimisation that has been proven to make sense.

minimize  max_s or mean_s Σ_g w_g f_g(p, s)   subject to   lower_g ≤ f_g(p, s) ≤ upper_g  for every hard goal g and scenario s
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from engine.analysis.study import MetricRequest
from engine.model.errors import EngineError, Path
from optimizers.problem.axes import Axis, Variable, Vector, axis_of
from optimizers.problem.bounds import doubts
from optimizers.problem.commands import PREFIX, CommandPath, commands_at, info_of
from optimizers.problem.errors import ProblemError, listed, refuse_repeats
from optimizers.problem.experiments import Experiment, check_experiment
from optimizers.problem.goals import Goal, check_together, request_of
from optimizers.problem.scenarios import Across, Scenario, Uncertain, check_scenario, parameter_of, uncertain_axis
from optimizers.problem.ties import Tie, resolved, tie_of

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram
    from engine.model.document import Remark
    from engine.model.parameters import ParameterInfo, Scalar


@dataclass(frozen=True, kw_only=True)
class Problem:
    """An optimisation that has been proven to make sense.

    ``scenario_names`` are as many as the scenarios, or none. ``across`` tells how the objectives of the scenarios become one. ``uncertain`` parameters may lie anywhere in their
    ranges: `optimizers.solving.solve` makes them scenarios, a method sees none. ``axes`` are the free variables, ``ties`` those that
    are given by expressions.

    Raises
    ------
    ProblemError
        No goal, contradictory bounds, an unknown parameter, metric, experiment or port, a zero-width range, a
        variable given by an expression: with the place in the document.
    """

    diagram: Diagram
    variables: tuple[Variable, ...]
    experiments: tuple[Experiment, ...] = ()
    goals: tuple[Goal, ...] = ()
    scenarios: tuple[Scenario, ...] = ({},)
    scenario_names: tuple[str | None, ...] = ()
    across: Across = Across.WORST
    uncertain: tuple[Uncertain, ...] = ()
    axes: tuple[Axis, ...] = field(init=False)
    ties: Mapping[str, Tie] = field(init=False)
    ranges: tuple[Axis, ...] = field(init=False)
    requests: tuple[MetricRequest, ...] = field(init=False)
    commands: Mapping[str, CommandPath] = field(init=False)

    def __post_init__(self) -> None:
        if not self.variables:
            raise ProblemError("variables must be at least one parameter, got none", at=("variables",))
        check_together(self.goals)
        if not self.scenarios:
            raise ProblemError(
                "scenarios must be at least one (an empty one is the system as it is), got none", at=("scenarios",)
            )
        if len(self.scenario_names) not in {0, len(self.scenarios)}:
            raise ProblemError(
                f"scenario_names must be as many as the scenarios, {len(self.scenarios)}, got {len(self.scenario_names)}",
                at=("scenarios",),
            )
        refuse_repeats([experiment.name for experiment in self.experiments], "experiments", "name")
        refuse_repeats([variable.parameter for variable in self.variables], "variables", "parameter")
        refuse_repeats([one.parameter for one in self.uncertain], "uncertain", "parameter")
        for index, experiment in enumerate(self.experiments):
            check_experiment(self.diagram, experiment, ("experiments", index))
        object.__setattr__(self, "commands", _command_paths(self.diagram, self.variables, self.experiments))
        axes, ties = _coordinates(self)
        experiments = {experiment.name: experiment for experiment in self.experiments}
        requests = tuple(request_of(self.diagram, goal, experiments, ("goals", i)) for i, goal in enumerate(self.goals))
        varied = {variable.parameter for variable in self.variables}
        for index, scenario in enumerate(self.scenarios):
            check_scenario(self.diagram, scenario, varied, self.scenario_place(index))
        taken = varied.union(*self.scenarios)
        ranges = tuple(
            uncertain_axis(self.diagram, one, taken, ("uncertain", i)) for i, one in enumerate(self.uncertain)
        )
        object.__setattr__(self, "axes", axes)
        object.__setattr__(self, "ties", ties)
        object.__setattr__(self, "ranges", ranges)
        object.__setattr__(self, "requests", requests)

    @cached_property
    def objectives(self) -> tuple[int, ...]:
        """Indices of the goals that are objectives."""
        return tuple(i for i, goal in enumerate(self.goals) if goal.sense is not None)

    @cached_property
    def doubts(self) -> tuple[Remark, ...]:
        """What is allowed in the goals and probably not meant; places count from the root of the request."""
        return doubts(self.goals)

    @cached_property
    def approached(self) -> tuple[int, ...]:
        """Indices of the goals whose excess counts in the objective.

        The soft ones; all of them where none is soft and none has a sense: what is wanted then is a point that serves every
        goal, with as much room as can be.
        """
        soft = tuple(i for i, goal in enumerate(self.goals) if goal.soft)
        return soft if soft or self.objectives else tuple(range(len(self.goals)))

    def scenario_name(self, index: int) -> str | None:
        """Return what a scenario is called, None where it has no name."""
        return self.scenario_names[index] if self.scenario_names else None

    def scenario_place(self, index: int) -> Path:
        """Return where the parameters of a scenario stand in the request: those of one with a name have a key of their own."""
        return ("scenarios", index) if self.scenario_name(index) is None else ("scenarios", index, "parameters")

    @cached_property
    def before(self) -> dict[str, float]:
        """The variables' present values in the system and its commands, whether within the bounds or not."""
        paths = [*(axis.parameter for axis in self.axes), *self.ties]
        return {path: self.info(path, ()).value for path in paths}

    def info(self, path: str, at: Path) -> ParameterInfo:
        """Return what is known of a parameter of the system or of a command.

        Raises
        ------
        ProblemError
            If there is none of that path; ``at`` is where it is named.
        """
        place = self.commands.get(path)
        if place is None:
            return parameter_of(self.diagram, path, at)
        try:
            return info_of(path, place, self.experiments)
        except EngineError as error:
            raise ProblemError(error.message, at=at) from error

    def experiments_at(self, values: Mapping[str, float]) -> tuple[Experiment, ...]:
        """Return the experiments with their commands at these values of the variables.

        Raises
        ------
        SignalError
            If a command refuses its value.
        """
        found = commands_at(values, self.commands, self.experiments)
        return tuple(replace(experiment, signals=found[experiment.name]) for experiment in self.experiments)

    def values(self, position: Sequence[float] | Vector) -> dict[str, float]:
        """Return the values (SI) of the free variables at a position in the unit cube, and of those tied to them.

        A tied one that has no value there is NaN; one that depends on a scenario is that of the first.
        """
        free = {axis.parameter: float(axis.value(float(x))) for axis, x in zip(self.axes, position, strict=True)}
        return {**free, **self.tied(free, self.scenarios[0])}

    def tied(self, free: Mapping[str, float], scenario: Scenario) -> dict[str, float]:
        """Return the values of the tied variables; NaN where an expression has none."""
        if not self.ties:
            return {}
        known: dict[str, Scalar] = {**scenario, **free}
        try:
            found = resolved(self.ties, known, self.own_value)
        except EngineError:
            return dict.fromkeys(self.ties, float("nan"))
        return {name: float(np.asarray(value).real) for name, value in found.items()}

    def own_value(self, path: str) -> float:
        """Return the present value of a parameter of the system."""
        return self.diagram.parameters[path].value

    def start(self) -> Vector:
        """Return the position of the start in the unit cube."""
        return np.array([axis.position(axis.start) for axis in self.axes])


def _coordinates(problem: Problem) -> tuple[tuple[Axis, ...], dict[str, Tie]]:
    """Return the free variables as coordinates, and those that are tied to them."""
    free = [variable.parameter for variable in problem.variables if variable.expression is None]
    tied = [variable.parameter for variable in problem.variables if variable.expression is not None]
    axes, ties = [], {}
    for index, variable in enumerate(problem.variables):
        at = ("variables", index)
        info = problem.info(variable.parameter, (*at, "parameter"))
        if variable.expression is None:
            axes.append(axis_of(variable, info, at))
        else:
            if variable.parameter in problem.commands:
                raise ProblemError(
                    f"{variable.parameter} must be a parameter of the system to be tied, got one of a command",
                    at=(*at, "expression"),
                )
            ties[variable.parameter] = tie_of(variable, problem.diagram, info, at, free=free, tied=tied)
    if not axes:
        raise ProblemError("variables must be at least one that is not tied, got none", at=("variables",))
    return tuple(axes), ties


def _command_paths(
    diagram: Diagram, variables: Sequence[Variable], experiments: Sequence[Experiment]
) -> dict[str, CommandPath]:
    """Return the variables that are numbers of commands, with their places."""
    found: dict[str, CommandPath] = {}
    for index, variable in enumerate(variables):
        path = variable.parameter
        if path in diagram.parameters or not path.startswith(PREFIX):
            continue
        at = ("variables", index, "parameter")
        place = CommandPath.of(path, experiments)
        if place is None:
            known = [f"{PREFIX}{e.name}.{port}.…" for e in experiments for port in e.signals]
            raise ProblemError(f"parameter must begin with one of {listed(known)}, got {path!r}", at=at)
        if diagram.nonlinear:
            raise ProblemError(f"{path} can be varied in a linear system only, got a nonlinear one", at=at)
        found[path] = place
    return found

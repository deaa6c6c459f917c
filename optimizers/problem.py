"""What is to be optimised: variables, experiments, goals and the scenarios that one choice of the variables must serve.

minimize  max_s Σ_g w_g f_g(p, s)   subject to   lower_g ≤ f_g(p, s) ≤ upper_g  for every goal g and scenario s
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.errors import EngineError, Path
from engine.metrics import catalogue as metric_catalogue
from engine.study import MetricRequest
from optimizers.commands import PREFIX, CommandPath, commands_at, info_of

if TYPE_CHECKING:
    from engine.diagram import Diagram, ParameterInfo
    from engine.signals import Signal

Scenario = Mapping[str, float]
"""Parameter path -> value (SI) that replaces the system's own."""

Vector = npt.NDArray[np.float64]

_END = 1e-12


class ProblemError(EngineError):
    """An optimisation that cannot be run; ``at`` counts from the root of the optimisation document."""


class Sense(StrEnum):
    """The direction in which a goal's metric is to go."""

    MINIMIZE = "minimize"
    MAXIMIZE = "maximize"


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """A parameter that may be chosen; what is None is taken from the parameter itself (start: its present value).

    A parameter is one of the system's, or a number of a command: ``signals.<experiment>.<port>.<parameter>``.
    """

    parameter: str
    lower: float | None = None
    upper: float | None = None
    scale: str | None = None
    start: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """Commands on input ports, by name; ``duration`` (s) limits only the integral metrics (None: the whole response)."""

    name: str
    signals: Mapping[str, Signal]
    duration: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """One metric, as an objective (``sense``), as a constraint (``lower``, ``upper``; SI), or as both.

    ``band`` (rad/s) is what a metric of the spectrum looks at.
    """

    metric: str
    experiment: str | None = None
    output: str | None = None
    source: str | None = None
    target: str | None = None
    open_at: str | None = None
    band: tuple[float, float] | None = None
    sense: Sense | None = None
    lower: float | None = None
    upper: float | None = None
    weight: float = 1.0

    @property
    def unlimited(self) -> bool:
        """Whether ``never_crosses`` means that the metric is as large as can be (margins, bandwidth)."""
        return metric_catalogue()[self.metric].absent_is_infinite


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """A variable with every default filled in: one coordinate of the search, scaled to 0…1."""

    parameter: str
    lower: float
    upper: float
    start: float
    log: bool
    unit: str = ""

    def value(self, position: Vector | float) -> Vector:
        """Return parameter values (SI) at positions in 0…1; the ends give the bounds themselves."""
        x = np.clip(np.asarray(position, dtype=np.float64), 0.0, 1.0)
        if self.log:
            values = self.lower * np.exp(x * math.log(self.upper / self.lower))
        else:
            values = self.lower + x * (self.upper - self.lower)
        # The ends are exact, though a descent reaches them only to rounding.
        return np.where(x <= _END, self.lower, np.where(x >= 1 - _END, self.upper, values))

    def position(self, value: float) -> float:
        """Return the position in 0…1 of a parameter value, clipped to the bounds."""
        inside = min(max(value, self.lower), self.upper)
        if self.log:
            return math.log(inside / self.lower) / math.log(self.upper / self.lower)
        return (inside - self.lower) / (self.upper - self.lower)

    def slope(self, value: float) -> float:
        """Return d(value)/d(position)."""
        return value * math.log(self.upper / self.lower) if self.log else self.upper - self.lower


@dataclass(frozen=True, kw_only=True)
class Problem:
    """An optimisation that has been proven to make sense.

    Raises
    ------
    ProblemError
        No objective, contradictory bounds, an unknown parameter, metric, experiment or port, a zero-width range, a
        variable given by an expression: with the place in the document.
    """

    diagram: Diagram
    variables: tuple[Variable, ...]
    experiments: tuple[Experiment, ...] = ()
    goals: tuple[Goal, ...] = ()
    scenarios: tuple[Scenario, ...] = ({},)
    axes: tuple[Axis, ...] = field(init=False)
    requests: tuple[MetricRequest, ...] = field(init=False)
    commands: Mapping[str, CommandPath] = field(init=False)

    def __post_init__(self) -> None:
        if not self.variables:
            raise ProblemError("variables must be at least one parameter, got none", at=("variables",))
        if not any(goal.sense for goal in self.goals):
            raise ProblemError(
                "goals must be at least one with a sense (minimize or maximize), got none", at=("goals",)
            )
        if not self.scenarios:
            raise ProblemError(
                "scenarios must be at least one (an empty one is the system as it is), got none", at=("scenarios",)
            )
        names = [experiment.name for experiment in self.experiments]
        _refuse_repeats(names, "experiments", "name")
        _refuse_repeats([variable.parameter for variable in self.variables], "variables", "parameter")
        for index, experiment in enumerate(self.experiments):
            _check_ports(self.diagram, experiment, ("experiments", index))
        object.__setattr__(self, "commands", _command_paths(self.diagram, self.variables, self.experiments))
        axes = tuple(_axis(self, variable, ("variables", i)) for i, variable in enumerate(self.variables))
        experiments = {experiment.name: experiment for experiment in self.experiments}
        requests = tuple(_request(self.diagram, goal, experiments, ("goals", i)) for i, goal in enumerate(self.goals))
        for index, scenario in enumerate(self.scenarios):
            _check_scenario(self.diagram, scenario, self.variables, ("scenarios", index))
        object.__setattr__(self, "axes", axes)
        object.__setattr__(self, "requests", requests)

    @cached_property
    def objectives(self) -> tuple[int, ...]:
        """Indices of the goals that are objectives."""
        return tuple(i for i, goal in enumerate(self.goals) if goal.sense is not None)

    @cached_property
    def before(self) -> dict[str, float]:
        """The variables' present values in the system and its commands, whether within the bounds or not."""
        return {axis.parameter: self.info(axis.parameter, ()).value for axis in self.axes}

    def info(self, path: str, at: Path) -> ParameterInfo:
        """Return what is known of a parameter of the system or of a command.

        Raises
        ------
        ProblemError
            If there is none of that path; ``at`` is where it is named.
        """
        place = self.commands.get(path)
        if place is None:
            return _parameter(self.diagram, path, at)
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
        """Return the parameter values (SI) at a position in the unit cube."""
        return {axis.parameter: float(axis.value(float(x))) for axis, x in zip(self.axes, position, strict=True)}

    def start(self) -> Vector:
        """Return the position of the start in the unit cube."""
        return np.array([axis.position(axis.start) for axis in self.axes])


def _refuse_repeats(names: Iterable[str], *at: str) -> None:
    seen: set[str] = set()
    for index, name in enumerate(names):
        if name in seen:
            raise ProblemError(
                f"{at[-1]} must be different for each of {at[0]}, got {name!r} twice", at=(at[0], index, at[-1])
            )
        seen.add(name)


def _parameter(diagram: Diagram, name: str, at: Path) -> ParameterInfo:
    try:
        return diagram.parameters[name]
    except KeyError:
        raise ProblemError(f"parameter must be one of the system's, got {name!r}", at=at) from None


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
            raise ProblemError(f"parameter must begin with one of {_list(known)}, got {path!r}", at=at)
        if diagram.nonlinear:
            raise ProblemError(f"{path} can be varied in a linear system only, got a nonlinear one", at=at)
        found[path] = place
    return found


def _axis(problem: Problem, variable: Variable, at: Path) -> Axis:
    name = variable.parameter
    info = problem.info(name, (*at, "parameter"))
    if info.bound:
        raise ProblemError(
            f"{name} must be a number to be varied, got an expression (vary the parameters it is made of)",
            at=(*at, "parameter"),
        )
    lower = _first(variable.lower, info.lower)
    upper = _first(variable.upper, info.upper)
    if lower is None or upper is None or not (math.isfinite(lower) and math.isfinite(upper)):
        key = "lower" if lower is None or not math.isfinite(lower) else "upper"
        raise ProblemError(
            f"{key} must be given for {name} (a finite number), the parameter itself has none", at=(*at, key)
        )
    _check_range(info, lower, upper, at)
    if variable.scale not in {None, "linear", "log"}:
        raise ProblemError(f"scale must be linear or log, got {variable.scale!r}", at=(*at, "scale"))
    if variable.scale == "log" and lower <= 0:
        raise ProblemError(f"lower must be > 0 {info.unit} on a logarithmic scale, got {lower:g}", at=(*at, "lower"))
    # A parameter's own log scale is a preference: bounds that include 0 or negative values override it.
    log = (variable.scale or info.scale) == "log" and lower > 0
    start = info.value if variable.start is None else variable.start
    if variable.start is not None and not lower <= start <= upper:
        raise ProblemError(f"start must be within {lower:g} … {upper:g} {info.unit}, got {start:g}", at=(*at, "start"))
    return Axis(
        parameter=name, lower=lower, upper=upper, start=min(max(start, lower), upper), log=log, unit=info.unit
    )  # fmt: skip


def _check_range(info: ParameterInfo, lower: float, upper: float, at: Path) -> None:
    if lower >= upper:
        got = "a range of zero width" if lower == upper else f"{upper:g}"
        raise ProblemError(f"upper must be > lower {lower:g} {info.unit}, got {got}", at=(*at, "upper"))
    for key, bound in (("lower", lower), ("upper", upper)):
        excluded = info.lower_open and info.path.startswith(PREFIX) and bound == info.lower
        if info.lower is not None and (bound < info.lower or excluded):
            sign = ">" if excluded else ">="
            raise ProblemError(
                f"{key} of {info.path} must be {sign} {info.lower:g} {info.unit}, got {bound:g}", at=(*at, key)
            )
        if info.upper is not None and bound > info.upper:
            raise ProblemError(
                f"{key} of {info.path} must be <= {info.upper:g} {info.unit}, got {bound:g}", at=(*at, key)
            )


def _first(given: float | None, default: float | None) -> float | None:
    return default if given is None else given


def _check_ports(diagram: Diagram, experiment: Experiment, at: Path) -> None:
    if not experiment.signals:
        raise ProblemError(
            f"input must be at least one command for experiment {experiment.name!r}, got none", at=(*at, "input")
        )
    for port in experiment.signals:
        if port not in diagram.inputs:
            raise ProblemError(f"port must be one of {_list(diagram.inputs)}, got {port!r}", at=(*at, "input", "port"))
    if experiment.duration is not None and not (experiment.duration > 0 and math.isfinite(experiment.duration)):
        raise ProblemError(f"duration must be > 0 s, got {experiment.duration:g}", at=(*at, "duration"))


def _request(diagram: Diagram, goal: Goal, experiments: Mapping[str, Experiment], at: Path) -> MetricRequest:
    """Check a goal and return it as a request to the engine."""
    metrics = metric_catalogue()
    if goal.metric not in metrics:
        raise ProblemError(f"metric must be one of {_list(metrics)}, got {goal.metric!r}", at=(*at, "metric"))
    _check_bounds(goal, at)
    domain = metrics[goal.metric].domain
    needs = {"time": ("experiment", "output"), "path": ("source", "target"), "loop": ("open_at",)}.get(domain, ())
    wire = {"source": "from", "target": "to"}
    for name in needs:
        if getattr(goal, name) is None:
            key = wire.get(name, name)
            raise ProblemError(f"{key} must be given for {goal.metric}, got nothing", at=(*at, key))
    experiment = None
    if goal.experiment is not None:
        if goal.experiment not in experiments:
            raise ProblemError(
                f"experiment must be one of {_list(experiments)}, got {goal.experiment!r}", at=(*at, "experiment")
            )
        experiment = experiments[goal.experiment]
    for name, known in (("output", diagram.outputs), ("target", diagram.outputs), ("source", diagram.inputs)):
        value = getattr(goal, name)
        if value is not None and value not in known:
            key = wire.get(name, name)
            raise ProblemError(f"{key} must be one of {_list(known)}, got {value!r}", at=(*at, key))
    if goal.open_at is not None:
        try:
            diagram.realize(open_at=goal.open_at)
        except EngineError as error:
            raise ProblemError(error.message, at=(*at, "open_at")) from error
    return MetricRequest(
        metric=goal.metric,
        signals=experiment.signals if experiment is not None and domain == "time" else {},
        output=goal.output,
        open_at=goal.open_at,
        source=goal.source,
        target=goal.target,
        duration=experiment.duration if experiment is not None and domain == "time" else None,
        band=goal.band,
    )


def _check_bounds(goal: Goal, at: Path) -> None:
    if goal.sense is None and goal.lower is None and goal.upper is None:
        raise ProblemError(f"goal {goal.metric} must have a sense, a lower or an upper bound, got none", at=at)
    for key, bound in (("lower", goal.lower), ("upper", goal.upper)):
        if bound is not None and not math.isfinite(bound):
            raise ProblemError(f"{key} must be a finite number, got {bound}", at=(*at, key))
    if goal.band is not None and not 0 <= goal.band[0] < goal.band[1] < math.inf:
        low, high = goal.band
        raise ProblemError(
            f"band must be [low, high] with 0 <= low < high rad/s, got [{low:g}, {high:g}]", at=(*at, "band")
        )
    if goal.lower is not None and goal.upper is not None and goal.lower > goal.upper:
        raise ProblemError(f"upper must be >= lower {goal.lower:g}, got {goal.upper:g}", at=(*at, "upper"))
    if not (goal.weight > 0 and math.isfinite(goal.weight)):
        raise ProblemError(f"weight must be > 0, got {goal.weight:g}", at=(*at, "weight"))


def _check_scenario(diagram: Diagram, scenario: Scenario, variables: Sequence[Variable], at: Path) -> None:
    varied = {variable.parameter for variable in variables}
    for name, value in scenario.items():
        info = _parameter(diagram, name, (*at, name))
        if info.bound:
            raise ProblemError(f"{name} must be a number to be replaced, got an expression", at=(*at, name))
        if name in varied:
            raise ProblemError(f"{name} must be either a variable or part of a scenario, got both", at=(*at, name))
        if not math.isfinite(value):
            raise ProblemError(f"{name} must be a finite number, got {value}", at=(*at, name))


def _list(names: Iterable[str]) -> str:
    return ", ".join(names) or "(none)"

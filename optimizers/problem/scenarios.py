"""What one choice of the variables must serve: sets of parameter values, and ranges in which parameters may lie."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from engine.model.errors import Path
from engine.model.names import no_parameter
from optimizers.problem.axes import Axis, logarithmic, range_of
from optimizers.problem.errors import ProblemError

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram
    from engine.model.parameters import ParameterInfo

Scenario = Mapping[str, float]
"""Parameter path -> value (SI) that replaces the system's own."""


class Across(StrEnum):
    """How the objective of several scenarios becomes one; a constraint must always hold in every one of them."""

    WORST = "worst"
    MEAN = "mean"


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertain:
    """A parameter that may lie anywhere in a range; its present value is the nominal one.

    ``scale`` tells how values are spread over the range, evenly or by factors, when the yield is asked for.
    """

    parameter: str
    lower: float
    upper: float
    scale: str | None = None


def check_scenario(diagram: Diagram, scenario: Scenario, varied: Collection[str], at: Path) -> None:
    """Refuse what a scenario cannot replace."""
    for name, value in scenario.items():
        info = parameter_of(diagram, name, (*at, name))
        if info.bound:
            raise ProblemError(f"{name} must be a number to be replaced, got an expression", at=(*at, name))
        if name in varied:
            raise ProblemError(f"{name} must be either a variable or part of a scenario, got both", at=(*at, name))
        if not math.isfinite(value):
            raise ProblemError(f"{name} must be a finite number, got {value}", at=(*at, name))


def uncertain_axis(diagram: Diagram, uncertain: Uncertain, taken: Collection[str], at: Path) -> Axis:
    """Return the range of an uncertain parameter as a coordinate, scaled to 0…1.

    Raises
    ------
    ProblemError
        An unknown or bound parameter, one that is a variable or part of a scenario, a range of no width.
    """
    name = uncertain.parameter
    info = parameter_of(diagram, name, (*at, "parameter"))
    if info.bound:
        raise ProblemError(f"{name} must be a number to be uncertain, got an expression", at=(*at, "parameter"))
    if name in taken:
        raise ProblemError(
            f"{name} must be either uncertain, a variable or part of a scenario, got two of them", at=(*at, "parameter")
        )
    lower, upper = range_of(info, uncertain.lower, uncertain.upper, at)
    return Axis(
        parameter=name, lower=lower, upper=upper, start=min(max(info.value, lower), upper),
        log=logarithmic(uncertain.scale, info, lower, at), unit=info.unit,
    )  # fmt: skip


def parameter_of(diagram: Diagram, name: str, at: Path) -> ParameterInfo:
    """Return what is known of a parameter of the system.

    Raises
    ------
    ProblemError
        If there is none of that path.
    """
    try:
        return diagram.parameters[name]
    except KeyError:
        raise ProblemError(no_parameter(name, diagram.parameters), at=at) from None

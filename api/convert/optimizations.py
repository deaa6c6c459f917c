"""Optimisations: the document as a problem of the core."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from api.convert.goals import goal_from_wire
from api.convert.signals import ReadChannel, signals_from_wire
from api.convert.values import optional_si, overrides_from_wire, si
from api.problems.documents import invalid
from api.problems.pointers import Place
from api.schemas.optimizations import (
    ExperimentDocument,
    OptimizationRequest,
    Scenario,
    ScenarioDocument,
    UncertainDocument,
    VariableDocument,
)
from engine.diagram.diagram import Diagram
from engine.model.errors import SignalError
from optimizers.problem import Across, Experiment, Problem, Uncertain, Variable
from optimizers.problem.commands import CommandPath, info_of


def problem_from_wire(
    document: OptimizationRequest,
    diagram: Diagram,
    *,
    read_channel: ReadChannel,
    variables: Sequence[VariableDocument] | None = None,
) -> Problem:
    """Return the optimisation problem, proven to make sense; ``variables`` are the document's unless an alternative has its own.

    Raises
    ------
    api.problems.documents.Problem
        422 with the place of a quantity in a wrong unit, an unknown port, path or signal.
    ProblemError
        For everything else that cannot be optimised.
    """
    experiments = tuple(
        _experiment(e, diagram, ("experiments", i), read_channel) for i, e in enumerate(document.experiments)
    )
    names = [experiment.name for experiment in experiments]
    return Problem(
        diagram=diagram,
        variables=tuple(
            _variable(v, diagram, experiments, ("variables", i))
            for i, v in enumerate(document.variables if variables is None else variables)
        ),
        experiments=experiments,
        goals=tuple(
            goal_from_wire(goal, diagram, ("goals", i), experiments=names) for i, goal in enumerate(document.goals)
        ),
        scenarios=tuple(
            _scenario(scenario, diagram, ("scenarios", i)) for i, scenario in enumerate(document.scenarios)
        ),
        scenario_names=_names(document.scenarios),
        across=Across(document.across_scenarios),
        uncertain=tuple(_uncertain(u, diagram, ("uncertain", i)) for i, u in enumerate(document.uncertain)),
    )


def _variable(
    document: VariableDocument, diagram: Diagram, experiments: Sequence[Experiment], place: Place
) -> Variable:
    info = diagram.parameters.get(document.parameter)
    command = CommandPath.of(document.parameter, experiments)
    unit = info.unit if info is not None else ""
    if info is None and command is not None:
        try:
            unit = info_of(document.parameter, command, experiments).unit
        except SignalError as error:
            raise invalid(error.message, *place, "parameter") from error
    lower, upper, start = (
        optional_si(getattr(document, key), unit, name=f"{key} of {document.parameter}", place=(*place, key))
        for key in ("lower", "upper", "start")
    )
    choices = None
    if document.choices is not None:
        choices = tuple(
            si(choice, unit, name=f"choices of {document.parameter}", place=(*place, "choices", i))
            for i, choice in enumerate(document.choices)
        )
    return Variable(
        parameter=document.parameter, lower=lower, upper=upper, scale=document.scale, start=start, choices=choices,
        integer=document.integer, expression=document.expression,
    )  # fmt: skip


def _scenario(document: Scenario, diagram: Diagram, place: Place) -> dict[str, float]:
    if isinstance(document, ScenarioDocument):
        return overrides_from_wire(document.parameters, diagram, place=(*place, "parameters"))
    return overrides_from_wire(document, diagram, place=place)


def _names(documents: Sequence[Scenario]) -> tuple[str | None, ...]:
    """Return what the scenarios are called, each differently; none where no scenario has a name."""
    names = tuple(document.name if isinstance(document, ScenarioDocument) else None for document in documents)
    for index, name in enumerate(names):
        if name is not None and name in names[:index]:
            raise invalid(f"name must be different for each scenario, got {name!r} twice", "scenarios", index, "name")
    return names if any(names) else ()


def _uncertain(document: UncertainDocument, diagram: Diagram, place: Place) -> Uncertain:
    info = diagram.parameters.get(document.parameter)
    lower, upper = (
        si(
            getattr(document, key),
            info.unit if info is not None else "",
            name=f"{key} of {document.parameter}",
            place=(*place, key),
        )
        for key in ("lower", "upper")
    )
    return Uncertain(parameter=document.parameter, lower=lower, upper=upper, scale=document.scale)


def _experiment(document: ExperimentDocument, diagram: Diagram, place: Place, read_channel: ReadChannel) -> Experiment:
    return Experiment(
        name=document.name,
        signals=signals_from_wire(document.input, diagram, place=(*place, "input"), read_channel=read_channel),
        duration=duration_from_wire(document.duration, place=(*place, "duration")),
    )


LONGEST = 1e9
"""The longest response that can be asked for, s: thirty years."""


def duration_from_wire(value: Any, *, place: Place) -> float | None:
    """Return the duration in s, None for "auto"."""
    if value == "auto":
        return None
    duration = si(value, "s", name="duration", place=place)
    if not 0.0 < duration <= LONGEST:
        raise invalid(f"duration must be > 0 and <= {LONGEST:g} s, got {duration:g}", *place)
    return duration

"""Optimisations: the document as a problem of the core, the result as the body that is remembered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from api.convert.signals import ReadChannel, signals_from_wire
from api.convert.values import band_from_wire, measured_to_wire, number, numbers, optional_si, overrides_from_wire, si
from api.errors import invalid
from api.pointers import Place
from api.schemas.jobs import ExperimentDocument, GoalDocument, OptimizationRequest, VariableDocument
from engine.diagram import Diagram
from engine.errors import SignalError
from engine.metrics import catalogue
from engine.verdicts import Verdict
from optimizers.certificate import Proof
from optimizers.commands import CommandPath, info_of
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from optimizers.result import GoalReport, GridMap, Result


def problem_from_wire(document: OptimizationRequest, diagram: Diagram, *, read_channel: ReadChannel) -> Problem:
    """Return the optimisation problem, proven to make sense.

    Raises
    ------
    api.errors.Problem
        422 with the place of a quantity in a wrong unit, an unknown port, path or signal.
    ProblemError
        For everything else that cannot be optimised.
    """
    experiments = tuple(
        _experiment(e, diagram, ("experiments", i), read_channel) for i, e in enumerate(document.experiments)
    )
    return Problem(
        diagram=diagram,
        variables=tuple(_variable(v, diagram, experiments, ("variables", i)) for i, v in enumerate(document.variables)),
        experiments=experiments,
        goals=tuple(_goal(goal, diagram, ("goals", i)) for i, goal in enumerate(document.goals)),
        scenarios=tuple(
            overrides_from_wire(scenario, diagram, place=("scenarios", i))
            for i, scenario in enumerate(document.scenarios)
        ),
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
    return Variable(parameter=document.parameter, lower=lower, upper=upper, scale=document.scale, start=start)


def _experiment(document: ExperimentDocument, diagram: Diagram, place: Place, read_channel: ReadChannel) -> Experiment:
    return Experiment(
        name=document.name,
        signals=signals_from_wire(document.input, diagram, place=(*place, "input"), read_channel=read_channel),
        duration=duration_from_wire(document.duration, place=(*place, "duration")),
    )


def duration_from_wire(value: Any, *, place: Place) -> float | None:
    """Return the duration in s, None for "auto"."""
    if value == "auto":
        return None
    duration = si(value, "s", name="duration", place=place)
    if duration <= 0.0:
        raise invalid(f"duration must be > 0 s, got {duration:g}", *place)
    return duration


def _goal(document: GoalDocument, diagram: Diagram, place: Place) -> Goal:
    metric = catalogue().get(document.metric)
    unit = _bound_unit(metric.unit if metric is not None else "", document, diagram)
    lower, upper = (
        optional_si(getattr(document, key), unit, name=f"{key} of {document.metric}", place=(*place, key))
        for key in ("lower", "upper")
    )
    return Goal(
        metric=document.metric,
        experiment=document.experiment,
        output=document.output,
        source=document.source,
        target=document.target,
        open_at=document.open_at,
        band=band_from_wire(document.band, place=(*place, "band")),
        sense=Sense(document.sense) if document.sense else None,
        lower=lower,
        upper=upper,
        weight=document.weight,
    )


def _bound_unit(unit: str, document: GoalDocument, diagram: Diagram) -> str:
    """Return the unit of a goal's bounds: the metric's own, or that of the output where the metric takes it from there."""
    if unit == "output" and document.output is not None:
        return diagram.output_units.get(document.output, "")
    # Products with the output's unit, and gains of a path, are reduced to SI base units.
    return "" if "output" in unit else unit


def result_to_wire(
    result: Result,
    document: OptimizationRequest,
    *,
    curves: Mapping[str, Any],
    system: Mapping[str, Any] | None,
    warnings: Sequence[Mapping[str, str]],
) -> dict[str, Any]:
    """Return the body of a finished optimisation, goals in the order of the request."""
    body: dict[str, Any] = {
        "status": str(result.status),
        "advice": result.advice,
        "best": {name: number(value) for name, value in result.best.items()},
        "goals": [_goal_report(goal, report) for goal, report in zip(document.goals, result.goals, strict=True)],
        "certificate": {
            "valid": result.certificate.valid,
            "worst_violation": number(result.certificate.worst_violation),
            "goals": [_proof(proof, document.goals) for proof in result.certificate.goals],
        },
        "curves": dict(curves),
        "elasticities": _elasticities(document.goals, result.goals),
        "history": [
            {
                "evaluation": point.evaluation,
                "objective": number(point.objective),
                "violation": number(point.violation),
                "variables": dict(point.variables),
            }
            for point in result.history
        ],
        "evaluations": result.evaluations,
        "seconds": result.seconds,
        "system": system,
        "warnings": [*warnings, *({"pointer": "", "detail": detail} for detail in result.warnings)],
    }
    if result.map is not None:
        body["map"] = _map(result.map)
    return body


def _goal_report(goal: GoalDocument, report: GoalReport) -> dict[str, Any]:
    return {
        "metric": goal.metric,
        "experiment": goal.experiment,
        "output": goal.output,
        "before": measured_to_wire(report.before),
        "after": measured_to_wire(report.after),
        "scenario": report.scenario,
        "met": report.met,
        "active": report.active,
        "multiplier": number(report.multiplier),
        "elasticities": {name: number(value) for name, value in report.elasticities.items()},
    }


def _elasticities(goals: Sequence[GoalDocument], reports: Sequence[GoalReport]) -> dict[str, Any]:
    """Return metric -> parameter -> elasticity at the optimum; of goals with the same metric, the first one's."""
    found: dict[str, Any] = {}
    for goal, report in zip(goals, reports, strict=True):
        missing = str(Verdict.ZERO_BASE if report.after.value is not None else report.after.verdict)
        found.setdefault(
            goal.metric,
            {
                name: {"value": number(value), "verdict": str(Verdict.OK) if value is not None else missing}
                for name, value in report.elasticities.items()
            },
        )
    return found


def _proof(proof: Proof, goals: Sequence[GoalDocument]) -> dict[str, Any]:
    where = proof.measured.at
    metric = catalogue()[goals[proof.goal].metric]
    return {
        "goal": proof.goal,
        "value": number(proof.measured.value),
        "verdict": str(proof.measured.verdict),
        "violation": number(proof.violation),
        "scenario": proof.scenario,
        "at": {"time" if metric.domain == "time" else "frequency": number(where)} if where is not None else None,
    }


def _map(grid: GridMap) -> dict[str, Any]:
    return {
        "axes": {name: numbers(values) for name, values in grid.axes.items()},
        "objective": numbers(np.ravel(grid.objective)),
        "violation": numbers(np.ravel(grid.violation)),
    }

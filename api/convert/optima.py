"""What came out of an optimisation, as the body that is remembered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from api.convert.values import measured_to_wire, number, numbers
from api.schemas.optimizations import GoalDocument
from engine.metrics import catalogue
from engine.model.verdicts import Verdict
from optimizers.evaluation.certificate import Proof
from optimizers.search.result import Front, Gap, GoalReport, GridMap, Result, Robustness, Yield


def result_to_wire(
    result: Result,
    goals: Sequence[GoalDocument],
    *,
    curves: Mapping[str, Any],
    system: Mapping[str, Any] | None,
    warnings: Sequence[Mapping[str, str]],
) -> dict[str, Any]:
    """Return the body of a finished optimisation, goals in the order of the request."""
    body: dict[str, Any] = {
        **summary_to_wire(result, goals),
        "curves": dict(curves),
        "elasticities": _elasticities(goals, result.goals),
        "sensitivity": _moves(result),
        "conflict": [{"goal": goal, "share": number(share)} for goal, share in result.conflict.items()],
        "bound": number(result.bound),
        "stationarity": number(result.stationarity),
        "history": [
            {
                "evaluation": point.evaluation,
                "objective": number(point.objective),
                "violation": number(point.violation),
                "variables": dict(point.variables),
                "seconds": point.seconds,
            }
            for point in result.history
        ],
        "evaluations": result.evaluations,
        "seconds": result.seconds,
        "effort": {stage: dict(spent) for stage, spent in result.effort.items()},
        "system": system,
        "warnings": [*warnings, *({"pointer": "", "detail": detail} for detail in result.warnings)],
    }
    if result.map is not None:
        body["map"] = _map(result.map)
    if result.front is not None:
        body |= _front(result.front)
    if result.gaps:
        body["cross_check"] = [_gap(gap) for gap in result.gaps]
    if result.robustness is not None:
        body["robustness"] = _robustness(result.robustness)
    if result.expected is not None:
        body["yield"] = yield_to_wire(result.expected)
    return body


def summary_to_wire(result: Result, goals: Sequence[GoalDocument]) -> dict[str, Any]:
    """Return how it ended, where, and the proof."""
    return {
        "status": str(result.status),
        "advice": result.advice,
        "best": {name: number(value) for name, value in result.best.items()},
        "objective": number(result.objective),
        "goals": [
            _goal_report(goal, report, result.scenario_names) for goal, report in zip(goals, result.goals, strict=True)
        ],
        "certificate": {
            "valid": result.certificate.valid,
            "worst_violation": number(result.certificate.worst_violation),
            "goals": [_proof(proof, goals, result.scenario_names) for proof in result.certificate.goals],
        },
    }


def _named(scenario: int, names: Sequence[str | None]) -> dict[str, str]:
    name = names[scenario] if names else None
    return {} if name is None else {"scenario_name": name}


def _goal_report(goal: GoalDocument, report: GoalReport, names: Sequence[str | None]) -> dict[str, Any]:
    return {
        "metric": goal.metric,
        "experiment": goal.experiment,
        "output": goal.output,
        "hard": goal.hard,
        "before": measured_to_wire(report.before),
        "after": measured_to_wire(report.after),
        "scenario": report.scenario,
        **_named(report.scenario, names),
        "met": report.met,
        "score": number(report.score),
        "active": report.active,
        "multiplier": number(report.multiplier),
        "elasticities": {name: number(value) for name, value in report.elasticities.items()},
    }


def _moves(result: Result) -> dict[str, Any]:
    """Return what becomes of the goals when a variable moves a little."""
    return {
        parameter: {
            side: None
            if move is None
            else {
                "value": move.value,
                "objective": number(move.objective),
                "violation": number(move.violation),
                "goals": [number(value) for value in move.values],
            }
            for side, move in sides.items()
        }
        for parameter, sides in result.moves.items()
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


def _proof(proof: Proof, goals: Sequence[GoalDocument], names: Sequence[str | None]) -> dict[str, Any]:
    where = proof.measured.at
    metric = catalogue()[goals[proof.goal].metric]
    return {
        "goal": proof.goal,
        "value": number(proof.measured.value),
        "verdict": str(proof.measured.verdict),
        "violation": number(proof.violation),
        "independent": number(proof.independent),
        "independent_tolerance": number(proof.tolerance),
        "scenario": proof.scenario,
        **_named(proof.scenario, names),
        "at": {"time" if metric.domain == "time" else "frequency": number(where)} if where is not None else None,
    }


def _map(grid: GridMap) -> dict[str, Any]:
    return {
        "axes": {name: numbers(values) for name, values in grid.axes.items()},
        "objective": numbers(np.ravel(grid.objective)),
        "violation": numbers(np.ravel(grid.violation)),
    }


def _front(front: Front) -> dict[str, Any]:
    return {
        "front": [
            {
                "parameters": {name: number(value) for name, value in point.variables.items()},
                "goals": [measured_to_wire(value) for value in point.values],
            }
            for point in front.points
        ],
        "hypervolume": number(front.hypervolume),
        "knee": front.knee,
        "ideal": [number(value) for value in front.ideal],
        "nadir": [number(value) for value in front.nadir],
    }


def _gap(gap: Gap) -> dict[str, Any]:
    return {
        "method": gap.method,
        "status": str(gap.status),
        "objective": number(gap.objective),
        "violation": number(gap.violation),
        "gap": number(gap.gap),
        "best": {name: number(value) for name, value in gap.best.items()},
    }


def _robustness(found: Robustness) -> dict[str, Any]:
    return {
        "scenarios": [dict(scenario) for scenario in found.scenarios],
        "worst": {
            "parameters": dict(found.worst),
            "violation": number(found.violation),
            "objective": number(found.objective),
        },
        "rounds": found.rounds,
        "evaluations": found.evaluations,
    }


def yield_to_wire(found: Yield) -> dict[str, Any]:
    """Return the share that meets every goal."""
    return {
        "share": found.share,
        "lower95": found.lower95,
        "upper95": found.upper95,
        "samples": found.samples,
        "unstable": found.unstable,
        "failures": [{"goal": goal, "samples": count} for goal, count in found.failures.items()],
    }

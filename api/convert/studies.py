"""Simulations, frequency responses and influence studies as replies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from api.convert.values import measured_to_wire, number, numbers
from api.problems.documents import invalid
from api.problems.pointers import Place, pointer
from engine.analysis.frequency_study import PathStudy
from engine.analysis.influence import Influence
from engine.analysis.limit_cycles import PredictedCycle
from engine.analysis.prediction import Prediction
from engine.analysis.study import FrequencyStudy, Simulation
from engine.metrics import catalogue


def check_metrics(names: Sequence[str] | None, *, place: Place = ("metrics",)) -> tuple[str, ...] | None:
    """Return the metrics asked for, each one known.

    Raises
    ------
    Problem
        422 at the first name that no metric has.
    """
    if names is None:
        return None
    for i, name in enumerate(names):
        if name not in catalogue():
            raise invalid(f"metric must be one of {', '.join(catalogue())}, got {name!r}", *place, i)
    return tuple(dict.fromkeys(names))


def warnings_to_wire(warnings: Iterable[Any], *, place: Place | None) -> list[dict[str, str]]:
    """Return warnings with pointers, each once.

    Parameters
    ----------
    warnings : iterable of engine.diagram.diagram.Warning
    place : tuple or None
        Where the system stands in the request; None when the request only names a stored one: there is nothing to
        point into then, and the sentence begins with the place in the document.
    """
    found: dict[tuple[str, str], None] = {}
    for warning in warnings:
        if place is None:
            found["/system", f"{pointer(warning.at)}: {warning.detail}"] = None
        else:
            found[pointer((*place, *warning.at)), warning.detail] = None
    return [{"pointer": where, "detail": detail} for where, detail in found]


def simulation_to_wire(simulation: Simulation) -> dict[str, Any]:
    """Return one variant of a simulation."""
    body: dict[str, Any] = {
        "time": numbers(simulation.time),
        "outputs": {name: numbers(curve) for name, curve in simulation.curves.items()},
        "metrics": {
            output: {metric: measured_to_wire(measured) for metric, measured in metrics.items()}
            for output, metrics in simulation.metrics.items()
        },
        "verdict": str(simulation.verdict),
        "error_estimate": None if simulation.error is None else number(simulation.error),
    }
    cycle = simulation.limit_cycle
    if cycle is not None:
        body["limit_cycle"] = {
            "frequency": number(cycle.frequency),
            "outputs": {name: number(value) for name, value in cycle.outputs.items()},
            "predictions": [_predicted_cycle(prediction) for prediction in cycle.predictions],
        }
    return body


def _predicted_cycle(cycle: PredictedCycle) -> dict[str, Any]:
    return {
        "block": cycle.block,
        "frequency": number(cycle.frequency),
        "amplitude": number(cycle.amplitude),
        "outputs": {name: number(value) for name, value in cycle.outputs.items()},
        "stable": cycle.stable,
    }


def roots_to_wire(roots: Iterable[complex]) -> list[dict[str, float | None]]:
    """Return poles or zeros."""
    return [{"real": number(root.real), "imag": number(root.imag)} for root in roots]


def _curve_to_wire(study: FrequencyStudy | PathStudy) -> dict[str, Any]:
    response = np.asarray(study.response)
    body: dict[str, Any] = {
        "frequency": numbers(study.frequency),
        "magnitude": numbers(np.abs(response)),
        "phase": numbers(study.phase),
        "real": numbers(response.real),
        "imag": numbers(response.imag),
        "metrics": {metric: measured_to_wire(measured) for metric, measured in study.metrics.items()},
        "zeros": None if study.zeros is None else roots_to_wire(study.zeros),
    }
    if study.unbounded:
        body["unbounded"] = [
            {"frequency": point.frequency, "verdict": str(point.verdict), "advice": point.advice}
            for point in study.unbounded
        ]
    return body


def frequency_to_wire(study: FrequencyStudy) -> dict[str, Any]:
    """Return one variant of a frequency response."""
    body: dict[str, Any] = {"verdict": str(study.verdict), **_curve_to_wire(study), "poles": roots_to_wire(study.poles)}
    if study.paths:
        body["paths"] = [{"from": one.source, "to": one.target, **_curve_to_wire(one)} for one in study.paths]
    if study.margins is not None:
        body["margins"] = {
            kind: [{"frequency": number(frequency), "value": number(value)} for frequency, value in crossings]
            for kind, crossings in (
                ("gain", study.margins.gain),
                ("phase", study.margins.phase),
                ("delay", study.margins.delay),
            )
        } | {"smallest_loop_gain": number(study.margins.smallest_loop_gain)}
    if study.nyquist is not None:
        body["nyquist"] = {
            "encirclements": study.nyquist.encirclements,
            "open_loop_unstable_poles": study.nyquist.open_loop,
            "closed_loop_unstable_poles": study.nyquist.closed_loop,
        }
    point = study.operating_point
    if point is not None:
        body["operating_point"] = {
            "inputs": {name: number(value) for name, value in point.inputs.items()},
            "outputs": {name: number(value) for name, value in point.outputs.items()},
            "rests": point.rests,
        }
        if study.margins is not None:
            body["limit_cycles"] = [_predicted_cycle(cycle) for cycle in study.limit_cycles]
    return body


def influence_to_wire(influence: Influence) -> dict[str, Any]:
    """Return base values, elasticities, coefficients of eq. (4) and what is strongest."""
    return {
        "base": {metric: measured_to_wire(measured) for metric, measured in influence.base.items()},
        "elasticities": {
            metric: {
                parameter: {
                    "value": number(elasticity.value),
                    "one_sided": bool(elasticity.one_sided),
                    "verdict": str(elasticity.verdict),
                    "method": str(elasticity.method),
                    "error": number(elasticity.error),
                }
                for parameter, elasticity in row.items()
            }
            for metric, row in influence.elasticities.items()
        },
        "coefficients": {
            metric: {
                parameter: {
                    "value": number(coefficient.value),
                    "change": number(coefficient.change),
                    "initial": number(coefficient.initial),
                    "final": number(coefficient.final),
                    "verdict": str(coefficient.verdict),
                }
                for parameter, coefficient in row.items()
            }
            for metric, row in influence.coefficients.items()
        },
        "strongest": {"by_parameter": dict(influence.by_parameter), "by_metric": dict(influence.by_metric)},
    }


def prediction_to_wire(prediction: Prediction) -> dict[str, Any]:
    """Return one set of changes with every metric as predicted and as it is."""
    return {
        "changes": {
            parameter: {"initial": number(change.initial), "final": number(change.final)}
            for parameter, change in prediction.changes.items()
        },
        "metrics": {
            name: {
                "value": number(metric.value),
                "law": str(metric.law),
                "straight": number(metric.straight),
                "exact": measured_to_wire(metric.exact),
                "error": number(metric.error),
                "relative_error": number(metric.relative_error),
                "verdict": str(metric.verdict),
            }
            for name, metric in prediction.metrics.items()
        },
    }

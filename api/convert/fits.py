"""Fit measures, residual tests and one-step predictions as bodies."""

from __future__ import annotations

from typing import Any

from api.convert.values import measured_to_wire, number, numbers
from engine.model.verdicts import Measured, Verdict
from engine.recordings.fit import DEFINITIONS, Fit, ResidualTests
from engine.recordings.validation.prediction import OneStep

_CONSTANT = "the measurement is constant in the window: choose one in which it moves"
_SILENT = "the measurement is 0 throughout the window: nothing can be relative to it"
_NEGATIVE = "the measurement has no positive value: NRMSE relates to its largest"
_ADVICE = {
    "fit_percent": _CONSTANT,
    "vaf_percent": _CONSTANT,
    "relative_error_percent": _SILENT,
    "nrmse_percent": _NEGATIVE,
}


def fit_to_wire(fit: Fit) -> dict[str, float | None]:
    """Return the fit measures by name."""
    return {name: number(getattr(fit, name)) for name in DEFINITIONS}


def measures_to_wire(fit: Fit) -> dict[str, Any]:
    """Return the fit measures with a verdict each: one that does not exist says why."""
    found = {}
    for name in DEFINITIONS:
        value = getattr(fit, name)
        there = value is not None
        found[name] = measured_to_wire(
            Measured(
                value=value,
                unit="%",
                verdict=Verdict.OK if there else Verdict.NOT_APPLICABLE,
                advice="" if there else _ADVICE[name],
            )
        )
    return found


def residuals_to_wire(tests: ResidualTests, sample_time: float) -> dict[str, Any]:
    """Return the residual tests with their curves and bounds; lags in s."""
    most = len(tests.autocorrelation) - 1
    return {
        "white": tests.white,
        "ljung_box": number(tests.ljung_box),
        "ljung_box_limit": number(tests.ljung_box_limit),
        "independent": tests.independent,
        "confidence": 0.99,
        "sample_time": sample_time,
        "lags": numbers([k * sample_time for k in range(-most, most + 1)]),
        "autocorrelation": numbers(tests.autocorrelation),
        "autocorrelation_bound": number(tests.autocorrelation_bound),
        "cross_correlation": numbers(tests.cross_correlation),
        "cross_correlation_bound": numbers(tests.cross_correlation_bound),
    }


def one_step_to_wire(found: OneStep | None) -> dict[str, Any] | None:
    """Return the fits of one-step predictions under names that nobody takes for a simulation's."""
    if found is None:
        return None
    return {
        "model": fit_to_wire(found.model),
        "last_sample": fit_to_wire(found.last_sample),
        "order": found.order,
    }

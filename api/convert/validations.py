"""Validations as bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from api.convert.fits import fit_to_wire, measures_to_wire, one_step_to_wire, residuals_to_wire
from api.convert.frequency_domain import frequency_domain_to_wire
from api.convert.values import number, numbers
from engine.diagram.diagram import Diagram
from engine.recordings.fit import DEFINITIONS
from engine.recordings.validation.remedy import Remedy, worthwhile
from engine.recordings.validation.steps import Step, Steps
from engine.recordings.validation.unmodelled import Unmodelled
from engine.recordings.validation.validate import Check, Output, Validated
from engine.recordings.validation.verdict import Grade

Samples = npt.NDArray[np.float64]
Intervals = Mapping[str, tuple[float | None, float | None]]

_SENTENCES = 3
_NEAR = 0.7
"""Of the error: when so much of it is out of reach of any linear model, that is worth saying."""


def validation_to_wire(
    found: Validated,
    diagram: Diagram,
    *,
    time: Samples,
    overrides: Mapping[str, float],
    intervals: Intervals,
    points: int | None,
) -> dict[str, Any]:
    """Return what was found, curves thinned out to ``points``."""
    stride = 1 if points is None else max(-(-time.size // points), 1)
    remarks = [sentence for output in found.outputs.values() for sentence in output.remarks]
    return {
        "outputs": {
            name: _output(output, unit=diagram.output_units.get(name, ""), time=time, stride=stride, points=points)
            for name, output in found.outputs.items()
        },
        "verdict": "fail" if found.grade is Grade.FAIL else "pass",
        "grade": str(found.grade),
        "basis": "simulation",
        "definitions": dict(DEFINITIONS),
        "adjustment": _adjustment(found, diagram, overrides, intervals) if overrides else None,
        "diagnosis": _diagnosis(found),
        "between_samples": None
        if found.between is None
        else {
            "chosen": str(found.between.way),
            "tried": {
                str(way): {name: fit_to_wire(fit) for name, fit in fits.items()}
                for way, fits in found.between.tried.items()
            },
        },
        "remarks": remarks,
        "advice": _advice(found),
    }


def _output(output: Output, *, unit: str, time: Samples, stride: int, points: int | None) -> dict[str, Any]:
    comparison = output.comparison
    begin, end = output.worst_interval
    return {
        **fit_to_wire(output.fit),
        "measures": measures_to_wire(output.fit),
        "worst_interval": [number(time[0] + begin), number(time[0] + end)],
        "baselines": {kind: fit_to_wire(fit) for kind, fit in output.baselines.items()},
        "residuals": residuals_to_wire(output.residuals, comparison.sample_time),
        "one_step_prediction": one_step_to_wire(output.one_step),
        "frequency_domain": None if output.frequency is None else frequency_domain_to_wire(output.frequency, points),
        "frequency_by_input": {
            name: frequency_domain_to_wire(one, points) for name, one in output.frequency_by_input.items()
        },
        "unmodelled": [_band(band) for band in output.unmodelled],
        "offset": number(output.offset),
        "unit": unit,
        "curves": {
            "time": numbers(time[::stride]),
            "measured": numbers(comparison.measured[::stride]),
            "simulated": numbers(comparison.simulated[::stride]),
        },
    }


def _band(band: Unmodelled) -> dict[str, Any]:
    mode = band.resonance
    return {
        "input": band.source,
        "lower": number(band.lower),
        "upper": number(band.upper),
        "frequency": number(band.frequency),
        "rms": number(band.rms),
        "share_percent": number(band.share_percent),
        "relative_percent": number(100 * band.relative),
        "mode": None
        if mode is None
        else {"frequency": number(mode.frequency), "damping_ratio": number(mode.damping_ratio)},
    }


def _adjustment(
    found: Validated, diagram: Diagram, overrides: Mapping[str, float], intervals: Intervals
) -> dict[str, Any]:
    """Return adjusted beside theoretical values and the fits of both, one row for each parameter."""
    rows = []
    for path, value in overrides.items():
        info = diagram.parameters[path]
        lower, upper = intervals.get(path, (None, None))
        rows.append(
            {
                "parameter": path,
                "unit": info.unit,
                "theoretical": number(info.value),
                "adjusted": number(value),
                "change_percent": number(100 * (value / info.value - 1)) if info.value != 0 else None,
                "lower95": number(lower),
                "upper95": number(upper),
                "theory_within": None if lower is None or upper is None else bool(lower <= info.value <= upper),
            }
        )
    return {
        "parameters": rows,
        "outputs": {
            name: {
                "theoretical": None if output.theoretical is None else fit_to_wire(output.theoretical),
                "adjusted": fit_to_wire(output.fit),
            }
            for name, output in found.outputs.items()
        },
    }


def _diagnosis(found: Validated) -> dict[str, Any] | None:
    if found.diagnosis is None:
        return None
    steps = found.diagnosis.steps
    return {
        "remedies": {
            name: [_remedy(remedy) for remedy in remedies] for name, remedies in found.diagnosis.remedies.items()
        },
        "parameters": [] if steps is None else [_step(step, found.checks.get(step.parameter)) for step in steps.alone],
        "together": None if steps is None else _together(steps, found.checks.get("together")),
        "note": found.note,
    }


def _step(step: Step, check: Check | None) -> dict[str, Any]:
    suggested = step.suggested if check is None else check.values[step.parameter]
    return {
        "parameter": step.parameter,
        "unit": step.unit,
        "value": number(step.value),
        "suggested": number(suggested),
        "change_percent": number(100 * (suggested / step.value - 1)) if step.value != 0 else None,
        "relative_error_percent": number(step.relative_error_percent),
        "checked_percent": None if check is None else number(check.relative_error_percent),
    }


def _together(steps: Steps, check: Check | None) -> dict[str, Any]:
    suggested = steps.together if check is None else check.values
    return {
        "suggested": {name: number(value) for name, value in suggested.items()},
        "relative_error_percent": number(steps.together_error_percent),
        "checked_percent": None if check is None else number(check.relative_error_percent),
    }


def _remedy(remedy: Remedy) -> dict[str, Any]:
    return {
        "kind": remedy.kind,
        "relative_error_percent": number(remedy.relative_error_percent),
        "values": {name: number(value) for name, value in remedy.values.items()},
        "sentence": remedy.sentence,
    }


def _advice(found: Validated) -> str:
    """Say in a few sentences what to try, the most helpful first."""
    if found.diagnosis is None:
        return ""
    said: list[tuple[float, str]] = [
        (remedy.relative_error_percent, f"{remedy.sentence} It would leave {remedy.relative_error_percent:.3g} %.")
        for remedies in found.diagnosis.remedies.values()
        for remedy in remedies
    ]
    if found.diagnosis.steps is not None:
        said += _moves(found.diagnosis.steps, found.checks)
    sentences = [sentence for _, sentence in sorted(said)[:_SENTENCES]]
    sentences += [_limit(name, output) for name, output in found.outputs.items() if _is_near_its_limit(output)]
    if not sentences and found.grade is Grade.FAIL:
        return (
            "Nothing simple explains the error: look at the worst interval, and at whether the model's structure "
            "(a nonlinearity, a mode, another input) is that of the machine."
        )
    return " ".join(sentences)


def _is_near_its_limit(output: Output) -> bool:
    error = output.fit.relative_error_percent
    limit = None if output.frequency is None else output.frequency.unexplained_percent
    # beyond the error itself it says that the estimate is no good: steps, slow systems
    return error is not None and limit is not None and _NEAR * error < limit <= error


def _limit(name: str, output: Output) -> str:
    assert output.frequency is not None
    return (
        f"By its coherence, {name} holds about {output.frequency.unexplained_percent:.3g} % that no linear model of this input "
        "explains: noise, another input, or a nonlinearity."
    )


def _moves(steps: Steps, checks: Mapping[str, Check]) -> list[tuple[float, str]]:
    """Return the sentence of the parameter that helps most, if one helps."""
    tried = [
        (checks[step.parameter].relative_error_percent, checks[step.parameter].values[step.parameter], step)
        if step.parameter in checks
        else (step.relative_error_percent, step.suggested, step)
        for step in steps.alone
    ]
    left, suggested, step = min(tried, key=lambda move: move[0])
    if not worthwhile(left, steps.present_error_percent):
        return []
    to = f"{suggested:.4g} {step.unit}".rstrip()
    return [(left, f"{step.parameter} would have to move to about {to}, which leaves {left:.3g} %.")]

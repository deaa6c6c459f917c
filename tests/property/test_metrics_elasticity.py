"""An elasticity equals the converged finite difference of the exact metric, and has no step size of its own."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.diagram import Diagram
from engine.study import Gradient, MetricRequest, measure
from engine.verdicts import Measured, Verdict
from tests.property.strategies import Servo, servos
from tests.reference.measuring import step

PARAMETERS = ("gain", "frequency", "damping", "lag")

STEP: dict[str, Any] = {"signals": {"r": step()}, "output": "y"}
REQUESTS = {
    **{
        name: MetricRequest(metric=name, **STEP)
        for name in (
            "rise_time",
            "settling_time",
            "response_time",
            "overshoot",
            "peak",
            "peak_time",
            "iae",
            "ise",
            "itae",
        )
    },
    "control_effort": MetricRequest(metric="control_effort", signals={"r": step()}, output="control"),
    "iae_to_1s": MetricRequest(metric="iae", **STEP, duration=1.0),
    "bandwidth": MetricRequest(metric="bandwidth", source="r", target="y"),
    "control_sensitivity_peak": MetricRequest(metric="control_sensitivity_peak", source="r", target="control"),
    **{
        name: MetricRequest(metric=name, open_at="error")
        for name in ("gain_margin", "phase_margin", "delay_margin", "sensitivity_peak", "complementary_peak")
    },
    "critical_frequency": MetricRequest(metric="critical_frequency"),
    "damping_ratio": MetricRequest(metric="damping_ratio"),
}


def values(diagram: Diagram, parameter: str, factor: float) -> list[float | None]:
    at = {parameter: diagram.parameters[parameter].value * factor}
    return [m.value for m, _ in measure(diagram, list(REQUESTS.values()), overrides=at)]


KINKED = {"settling_time", "response_time", "overshoot", "peak", "peak_time", "iae", "itae", "iae_to_1s"}


def measured_overshoot(exact: list[tuple[Measured, Gradient | None]]) -> float:
    return exact[list(REQUESTS).index("overshoot")][0].value or 0.0


@given(servos(), st.sampled_from(PARAMETERS))
def test_gradient_equals_the_converged_difference(servo: Servo, parameter: str) -> None:
    diagram = servo.diagram()
    exact = measure(diagram, list(REQUESTS.values()), gradient=[parameter])
    assert sum(m.verdict is Verdict.OK for m, _ in exact) >= 12
    at = diagram.parameters[parameter].value
    # Richardson on central differences: error of the order h^6; smaller steps would only show the rounding of the metrics
    steps = (4e-3, 2e-3, 1e-3)
    pairs = [(values(diagram, parameter, 1 + h), values(diagram, parameter, 1 - h)) for h in steps]
    for i, name in enumerate(REQUESTS):
        measured, gradient = exact[i]
        if measured.value is None:
            continue
        assert gradient is not None, name
        if name == "peak_time" and measured_overshoot(exact) < 1e-4:
            continue  # a peak that hardly rises above the final value has hardly an instant: differences see rounding
        sides = [(up[i], down[i]) for up, down in pairs]
        assert all(up is not None and down is not None for up, down in sides), name
        d = [(up - down) / (2 * h) for (up, down), h in zip(sides, steps, strict=True)]  # type: ignore[operator]
        first = [(4 * d[k + 1] - d[k]) / 3 for k in range(2)]
        converged = (16 * first[1] - first[0]) / 15
        scale = max(abs(measured.value), 1e-9)
        if name in KINKED and abs(converged - first[1]) > 1e-4 * scale:
            # Two orders that disagree stand at a jump (a peak that grazes the settling band, two peaks of one height) or
            # at a kink (an overshoot that just begins, an error that just touches zero), not at a derivative.
            continue
        slack = 2e-5 * scale + 2 * abs(converged - first[1]) if name in KINKED else 2e-7 * scale
        assert gradient.values[0] * at == pytest.approx(converged, rel=2e-5, abs=slack), name

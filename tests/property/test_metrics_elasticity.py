"""An elasticity equals the converged finite difference of the exact metric, and has no step size of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.analysis.study import MetricRequest, measure
from engine.diagram.diagram import Diagram
from engine.model.verdicts import Verdict
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
        for name in (
            "gain_margin",
            "gain_margin_up",
            "gain_margin_down",
            "phase_margin",
            "delay_margin",
            "disk_margin",
            "sensitivity_peak",
            "complementary_peak",
        )
    },
    "critical_frequency": MetricRequest(metric="critical_frequency"),
    "damping_ratio": MetricRequest(metric="damping_ratio"),
}


# A metric may jump or have a kink somewhere: a peak that grazes the settling band, two peaks of one height, a shoulder at the
# level of 90 %. A difference across such a place says nothing; one with other steps avoids it.
COARSE, FINE = (4e-3, 2e-3, 1e-3), (1e-4, 5e-5, 2.5e-5)


def differences(diagram: Diagram, parameter: str, steps: tuple[float, ...]) -> dict[str, float]:
    """Return d metric / d ln parameter by Richardson on central differences, error of the order h^6; NaN where one is absent."""
    at = diagram.parameters[parameter].value
    rows = []
    for h in steps:
        up, down = (
            [
                np.nan if m.value is None else m.value
                for m, _ in measure(diagram, list(REQUESTS.values()), overrides={parameter: at * (1 + sign * h)})
            ]
            for sign in (1, -1)
        )
        rows.append((np.array(up) - np.array(down)) / (2 * h))
    first = [(4 * rows[k + 1] - rows[k]) / 3 for k in range(2)]
    return dict(zip(REQUESTS, (16 * first[1] - first[0]) / 15, strict=True))


@given(servos(), st.sampled_from(PARAMETERS))
def test_gradient_equals_the_converged_difference(servo: Servo, parameter: str) -> None:
    diagram = servo.diagram()
    exact = dict(zip(REQUESTS, measure(diagram, list(REQUESTS.values()), gradient=[parameter]), strict=True))
    assert sum(m.verdict is Verdict.OK for m, _ in exact.values()) >= 12
    coarse = differences(diagram, parameter, COARSE)
    fine: dict[str, float] = {}
    for name, (measured, gradient) in exact.items():
        if measured.value is None:
            continue
        assert gradient is not None, name
        if name == "peak_time" and (exact["overshoot"][0].value or 0.0) < 1e-4:
            continue  # a peak that hardly rises above the final value has hardly an instant: differences see rounding
        got = gradient.values[0] * diagram.parameters[parameter].value
        # An overshoot is a difference of numbers near 1, however small it is itself.
        scale = 1.0 if name == "overshoot" else max(abs(measured.value), 1e-9)
        # The fine steps show the rounding of the metrics (1e-11) magnified by 1/h.
        if got == pytest.approx(coarse[name], rel=2e-5, abs=2e-7 * scale):
            continue
        fine = fine or differences(diagram, parameter, FINE)
        assert got == pytest.approx(fine[name], rel=1e-4, abs=2e-5 * scale), (name, got, coarse[name])

"""Hydraulic axes with a true stick under position control, for seconds: against their equations by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engine.exact.nonlinear.integrate import Integration
from engine.model.verdicts import Verdict
from tests.reference.event_driven._hydraulic import Hydraulic
from tests.reference.event_driven._loop import Command

STICK = {"coulomb": 400.0, "static": 900.0, "stribeck_velocity": 0.01}
AXIS = {
    "area_a": 2e-3, "area_b": 1.2e-3, "stroke": 0.5, "mass": 100.0, "viscous_friction": 500.0, "leakage": 0.0, "bulk_modulus": 1e9,
    "x0": 0.25, "pa": 3e6, "pb": 5e6, "overlap": 0.0, "stroke_valve": 1e-3, "kp": 8e-3, "T": 5e-3, "limit": 1e-3, "offset": 0.0,
    "friction": STICK, "duration": 0.6,
}  # fmt: skip
STEP, RAMP = Command(kind="step", size=0.3), Command(kind="ramp", size=0.004)
CASES: dict[str, tuple[dict[str, Any], Command]] = {
    "step": ({}, STEP),
    "overlap": ({"overlap": 2e-5}, STEP),
    "leakage": ({"leakage": 2e-12}, STEP),
    "a small imbalance": ({"pb": 5e6 * (1 + 1e-4)}, STEP),
    "an imbalance that breaks loose": ({"pb": 4.2e6}, STEP),
    "no pressure": ({"pa": 0.0, "pb": 0.0}, STEP),
    "supply against tank": ({"pa": 10e6, "pb": 0.0}, STEP),
    "stick-slip on a ramp": ({"offset": 0.25, "duration": 1.2}, RAMP),
    "stick-slip over an overlap": ({"offset": 0.25, "overlap": 2e-5, "leakage": 1e-12, "duration": 1.2}, RAMP),
    "from the lower end": ({"x0": 0.0, "duration": 0.5}, Command(kind="ramp", size=0.02)),
    "to the upper end": ({"x0": 0.4}, Command(kind="step", size=0.6)),
    "smooth, 1e-4 m/s": ({"friction": {"coulomb": 400.0, "transition_velocity": 1e-4}, "duration": 0.2}, STEP),
    "smooth, 1e-5 m/s": ({"friction": {"coulomb": 400.0, "transition_velocity": 1e-5}, "duration": 0.1}, STEP),
}


@pytest.mark.parametrize("case", CASES)
def test_a_hydraulic_axis(case: str) -> None:
    changed, command = CASES[case]
    axis = Hydraulic(AXIS | changed, command)
    course = axis.course()
    outcome = Integration(axis.diagram().laws(), {"r": command.signal()}).advance(axis.duration)
    assert outcome.verdict is Verdict.OK, outcome.advice
    times = np.linspace(0.0, axis.duration, 301)
    exact = course.outputs(times)
    for k, name in enumerate(axis.names):
        size = np.abs(exact[:, k]).max()
        assert np.abs(outcome.output(k).sample(times) - exact[:, k]).max() <= 1e-8 * size, name
    if "stick-slip" in case:
        assert len(course.happened) >= 6

"""What no metric may depend on, and how it must scale.

The number of samples changes no metric. A command of k times the amplitude, and a system that is k times slower, change each metric
by the powers that the metric declares.
"""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.analysis.study import frequency_response, simulate
from engine.metrics import catalogue
from engine.model.verdicts import Verdict
from tests.property.strategies import Plant, Servo, gains, plants, servos
from tests.reference.measuring import step
from tests.reference.systems import transfer_function


def measured(plant: Plant, *, amplitude: float = 1.0, time_scale: float = 1.0, samples: int = 10) -> dict[str, Any]:
    diagram = transfer_function(*plant.polynomials(time_scale))
    done = simulate(diagram, signals={"u": step(amplitude)}, samples=samples)
    study = frequency_response(diagram, source="u", target="y")
    return {**done.metrics["y"], **study.metrics}


def assert_scaled(
    before: dict[str, Any], after: dict[str, Any], amplitude: float, time_scale: float, relative: float
) -> None:
    assert before.keys() == after.keys()
    values = [m.value for m in before.values() if m.value is not None]
    assert len(values) >= 5, "the system has metrics"
    for name, base in before.items():
        metric = catalogue()[name]
        assert after[name].verdict is base.verdict, name
        if base.value is not None:
            factor = amplitude**metric.amplitude_power * time_scale**metric.time_power
            # Differences that vanish (an overshoot of 0) are compared on the scale of the ratio itself.
            assert after[name].value == pytest.approx(base.value * factor, rel=relative, abs=1e-11 * abs(factor)), name


@pytest.mark.parametrize("kind", catalogue())
def test_the_declared_powers_are_those_of_the_unit(kind: str) -> None:
    metric = catalogue()[kind]
    factors = re.findall(r"(/?)(output|rad/s|s)(?:\*\*([\d.]+))?", metric.unit)
    powers = {name: float(power or 1) * (-1 if over else 1) for over, name, power in factors}
    ratio = metric.domain == "path"  # the gain of a path does not know the command
    assert metric.amplitude_power == (0 if ratio else powers.get("output", 0))
    assert metric.time_power == powers.get("s", 0) - powers.get("rad/s", 0)


@given(plants())
def test_samples_change_no_metric(plant: Plant) -> None:
    assert_scaled(measured(plant, samples=10), measured(plant, samples=10_000), 1.0, 1.0, relative=1e-9)


@given(servos())
def test_samples_change_no_metric_of_a_loop(servo: Servo) -> None:
    few, many = (simulate(servo.diagram(), signals={"r": step()}, samples=n).metrics for n in (10, 10_000))
    for output in ("y", "control"):
        assert_scaled(few[output], many[output], 1.0, 1.0, relative=1e-9)


@given(plants(), gains())
def test_amplitude(plant: Plant, amplitude: float) -> None:
    # A negative amplitude turns the picture over: magnitudes scale with |amplitude|.
    before, after = measured(plant), measured(plant, amplitude=amplitude)
    signed = {"steady_state_error"}
    for name in signed & before.keys():
        value = before.pop(name).value
        assert after.pop(name).value == pytest.approx(value * amplitude, rel=1e-9, abs=1e-11 * abs(amplitude))
    assert_scaled(before, after, abs(amplitude), 1.0, relative=1e-9)


@given(plants(), st.floats(-3, 3).map(lambda e: 10**e))
def test_time(plant: Plant, time_scale: float) -> None:
    assert_scaled(measured(plant), measured(plant, time_scale=time_scale), 1.0, time_scale, relative=1e-8)


@given(plants(), plants())
def test_verdict_ok_means_a_value(first: Plant, second: Plant) -> None:
    for plant in (first, second):
        for name, got in measured(plant).items():
            assert (got.value is not None) is (got.verdict is Verdict.OK), name
            assert got.verdict is Verdict.OK or got.advice, name

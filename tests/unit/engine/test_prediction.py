"""Predictions from elasticities against closed forms: exact for products of powers, first order elsewhere."""

from __future__ import annotations

import math

import pytest

from engine.analysis.prediction import Law, predict
from engine.analysis.study import MetricRequest
from engine.diagram.diagram import Diagram
from engine.model.errors import DiagramError
from engine.model.verdicts import Verdict
from tests.reference.measuring import step
from tests.reference.systems import block, system

SETTLING = MetricRequest(metric="settling_time", signals={"u": step()}, output="y")
OVERSHOOT = MetricRequest(metric="overshoot", signals={"u": step()}, output="y")
ERROR = MetricRequest(metric="steady_state_error", signals={"u": step()}, output="y")


def lag(mass: float = 2.0, friction: float = 4.0) -> Diagram:
    """1 / (m s / b + 1): time constant m / b."""
    return system(
        {
            "u": block("input"),
            "p": block("transfer_function", numerator=["=gain"], denominator=["=mass/friction", 1]),
        },
        ["u -> p"],
        {"y": "p"},
        {"mass": mass, "friction": friction, "gain": 1.0},
    )


def second_order(damping: float) -> Diagram:
    return system(
        {
            "u": block("input"),
            "p": block("transfer_function", numerator=[9.0], denominator=[1, "=2*zeta*3", 9.0]),
        },
        ["u -> p"],
        {"y": "p"},
        {"zeta": damping},
    )


def test_a_product_of_powers_is_predicted_exactly_however_large_the_change() -> None:
    # t_s = (m / b) ln 50
    found = predict(lag(), {"settling": SETTLING}, {"mass": 6.0, "friction": 1.0})
    metric = found.metrics["settling"]
    assert metric.base.value == pytest.approx(0.5 * math.log(50), rel=1e-12)
    assert (metric.law, metric.verdict) == (Law.POWER, Verdict.OK)
    assert metric.value == pytest.approx(6.0 * math.log(50), rel=1e-11)
    assert metric.exact.value == pytest.approx(6.0 * math.log(50), rel=1e-11)
    assert metric.error == pytest.approx(0.0, abs=1e-9)
    # the straight line: 0.5 ln 50 (1 + 4 / 2 + 3 / 4)
    assert metric.straight == pytest.approx(0.5 * math.log(50) * (1 + 2.0 + 0.75), rel=1e-11)
    assert (found.changes["mass"].initial, found.changes["mass"].final) == (2.0, 6.0)


def test_the_error_is_that_of_the_prediction() -> None:
    # overshoot e^(-πζ/√(1-ζ²)): elasticity -πζ/(1-ζ²)^(3/2)
    def exact(zeta: float) -> float:
        return math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2))

    metric = predict(second_order(0.3), {"overshoot": OVERSHOOT}, {"zeta": 0.33}).metrics["overshoot"]
    elasticity = -math.pi * 0.3 / (1 - 0.09) ** 1.5
    assert metric.value == pytest.approx(exact(0.3) * 1.1**elasticity, rel=1e-9)
    assert metric.straight == pytest.approx(exact(0.3) * (1 + 0.1 * elasticity), rel=1e-9)
    assert metric.exact.value == pytest.approx(exact(0.33), rel=1e-9)
    assert metric.error == pytest.approx(exact(0.3) * 1.1**elasticity - exact(0.33), rel=1e-7)
    assert metric.relative_error == pytest.approx(metric.error / exact(0.33), rel=1e-12)


def test_the_error_falls_with_the_square_of_the_change() -> None:
    errors = [
        predict(second_order(0.3), {"o": OVERSHOOT}, {"zeta": 0.3 * (1 + h)}).metrics["o"].error for h in (2e-2, 1e-2)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def test_a_metric_that_is_zero_is_predicted_on_the_straight_line() -> None:
    # the error of 1 / (T s + 1) is 1 - gain
    metric = predict(lag(), {"error": ERROR}, {"gain": 1.2}).metrics["error"]
    assert metric.base.value == pytest.approx(0.0, abs=1e-15)
    assert metric.law is Law.STRAIGHT
    assert metric.value == pytest.approx(-0.2, rel=1e-12)
    assert metric.error == pytest.approx(0.0, abs=1e-13)


def test_a_change_of_sign_is_predicted_on_the_straight_line() -> None:
    request = MetricRequest(metric="steady_state_error", signals={"u": step()}, output="y")
    metric = predict(lag(), {"error": request}, {"gain": -1.0}).metrics["error"]
    assert (metric.law, metric.value) == (Law.STRAIGHT, pytest.approx(2.0, rel=1e-12))


def test_what_does_not_exist_is_not_predicted_but_the_exact_value_is_told() -> None:
    # overdamped: no oscillation; ζ = 0.5 afterwards
    request = MetricRequest(metric="critical_frequency")
    metric = predict(second_order(1.5), {"w": request}, {"zeta": 0.5}).metrics["w"]
    assert (metric.value, metric.error, metric.verdict) == (None, None, Verdict.NOT_OSCILLATORY)
    assert metric.exact.value == pytest.approx(3.0, rel=1e-12)


def test_after_a_change_into_instability_the_error_is_absent() -> None:
    metric = predict(second_order(0.3), {"o": OVERSHOOT}, {"zeta": -0.1}).metrics["o"]
    assert metric.value is not None
    assert (metric.error, metric.exact.verdict) == (None, Verdict.UNSTABLE)


def test_a_jump_at_the_base_is_flagged() -> None:
    # the first minimum touches the 5 % band where e^(-πζ/√(1-ζ²)) = 0.05: beyond, the last entry is earlier
    touching = math.log(20) / math.hypot(math.pi, math.log(20))
    request = MetricRequest(metric="response_time", signals={"u": step()}, output="y")
    metric = predict(second_order(touching), {"t": request}, {"zeta": touching * 1.01}).metrics["t"]
    assert metric.verdict is Verdict.DISCONTINUOUS
    assert metric.value is not None


def test_an_unknown_parameter_is_refused() -> None:
    with pytest.raises(DiagramError, match="ghost"):
        predict(lag(), {"settling": SETTLING}, {"ghost": 1.0})

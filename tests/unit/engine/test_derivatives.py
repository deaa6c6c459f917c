"""Velocity, acceleration and effort: of the output that its unit says, of a position its derivatives, else as the request says."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import simulate
from engine.diagram.diagram import Diagram, compile_system
from engine.model.metric_options import Options
from engine.model.verdicts import Measured, Verdict
from engine.signals import make
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, ProblemError, Sense, Variable
from tests.unit.engine.diagrams import block, document

MASS = {"mass": 2.0, "stiffness": 50.0, "damping": 3.0}
S_CURVE = make("s_curve", {"distance": 1.0, "max_velocity": 2.0, "max_acceleration": 20.0, "max_jerk": 400.0})


def mass() -> Diagram:
    return compile_system(
        document(
            {"r": block("input"), "m": block("mass_spring_damper", **MASS)},
            ["r -> m.force"],
            {"x": "m.position", "v": "m.velocity"},
        )
    )


def plain(law: Any = None, **parameters: float) -> Diagram:
    """Return a loop whose outputs have no unit: y'' = k (r - y) - c y'."""
    blocks = {
        "r": block("input"),
        "e": block("sum", signs="+-"),
        "u": law or block("gain", gain="=k"),
        "g": block("transfer_function", numerator=[1.0], denominator=[1.0, "=c", 0.0]),
    }
    return compile_system(
        document(
            blocks,
            ["r -> e.in1", "g -> e.in2", "e -> u", "u -> g"],
            {"y": "g", "effort": "u"},
            **({"k": 40.0, "c": 3.0} | parameters),
        )
    )


def read(diagram: Diagram, metric: str, output: str, signal: Any = S_CURVE, **options: Any) -> Measured:
    request = MetricRequest(metric=metric, signals={"r": signal}, output=output, options=Options(**options))
    ((found, _),) = measure(diagram, [request])
    return found


def motion(k: float, c: float, end: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity and acceleration of y'' = k (r - y) - c y' on a fine grid."""
    t = np.linspace(0, end, 400_001)
    corners = sorted({0.0, end, *(b for b in S_CURVE.breakpoints() if 0 < b < end)})
    y, state = np.zeros((2, len(t))), [0.0, 0.0]
    for a, b in pairwise(corners):
        inside = (t >= a) & (t <= b)
        found = solve_ivp(
            lambda s, z: [z[1], k * (float(S_CURVE.value(np.array([s]))[0].real) - z[0]) - c * z[1]], (a, b), state,
            method="DOP853", dense_output=True, rtol=1e-12, atol=1e-13,
        )  # fmt: skip
        y[:, inside], state = found.sol(t[inside]), list(found.y[:, -1])
    r = S_CURVE.value(t).real
    return y[1], k * (r - y[0]) - c * y[1]


def test_of_a_position_its_derivatives_are_measured() -> None:
    found = mass()
    for signal in (S_CURVE, make("step", {"amplitude": 30.0})):
        by_position, by_velocity = (read(found, "max_velocity", name, signal) for name in ("x", "v"))
        assert by_position.value == pytest.approx(by_velocity.value, rel=1e-12)
        assert by_position.unit == by_velocity.unit == "m/s"
    own, other = (read(found, "max_acceleration", name) for name in ("x", "v"))
    assert own.value == pytest.approx(other.value, rel=1e-10)
    assert own.unit == other.unit == "m/s**2"


def test_of_an_output_without_a_unit_the_request_says_which() -> None:
    velocity, acceleration = motion(40.0, 3.0)
    for metric, derivative, expected in (
        ("max_velocity", 1, np.abs(velocity).max()), ("max_acceleration", 2, np.abs(acceleration).max()),
        ("max_acceleration", 1, np.abs(velocity).max()),
    ):  # fmt: skip
        found = read(plain(), metric, "y", derivative=derivative)
        assert found.value == pytest.approx(expected, rel=1e-8)
        assert found.unit == ("1/s" if derivative == 1 else "1/s**2")
    for metric in ("max_velocity", "max_acceleration", "control_effort"):
        found = read(plain(), metric, "y")
        assert (found.value, found.verdict) == (None, Verdict.NOT_APPLICABLE)
        assert "derivative" in found.advice
    assert read(plain(), "max_velocity", "y", derivative=0).value == pytest.approx(read(plain(), "peak", "y").value)
    assert read(plain(), "control_effort", "effort").verdict is Verdict.OK
    assert "is a position (m)" in read(mass(), "control_effort", "x").advice


def test_a_nonlinear_response_is_differentiated_too() -> None:
    """A limit that is never reached: the same loop, followed by the nonlinear engine."""
    limited = plain(block("p", kp="=k", lower=-1e6, upper=1e6))
    assert limited.nonlinear
    velocity, acceleration = motion(40.0, 3.0)
    assert read(limited, "max_velocity", "y", derivative=1).value == pytest.approx(np.abs(velocity).max(), rel=1e-8)
    assert read(limited, "max_acceleration", "y", derivative=2).value == pytest.approx(
        np.abs(acceleration).max(), rel=1e-6
    )


def test_its_slopes_are_those_of_differences() -> None:
    request = MetricRequest(
        metric="max_acceleration", signals={"r": S_CURVE}, output="y", options=Options(derivative=2)
    )
    ((_, gradient),) = measure(plain(), [request], gradient=["k", "c"])
    assert gradient is not None
    for slope, name, value in zip(gradient.values, ("k", "c"), (40.0, 3.0), strict=True):
        h = 1e-4 * value
        sides = [
            read(plain(**{name: value + s * h}), "max_acceleration", "y", derivative=2).value for s in (-2, -1, 1, 2)
        ]
        assert slope == pytest.approx((sides[0] - 8 * sides[1] + 8 * sides[2] - sides[3]) / (12 * h), rel=1e-7)


def test_a_derivative_that_is_infinite_is_told() -> None:
    """A step of r makes the acceleration of y jump, its effort too; the velocity of the effort is infinite."""
    found = read(plain(), "max_velocity", "effort", make("step", {}), derivative=1)
    assert (found.value, found.verdict) == (None, Verdict.DIVERGES)
    assert "jumps at 0 s" in found.advice
    assert read(plain(), "max_acceleration", "y", make("step", {}), derivative=2).value == pytest.approx(
        40.0, rel=1e-12
    )


def test_fast_paths_leave_it_to_the_exact_one() -> None:
    asked = MetricRequest(metric="max_velocity", signals={"r": S_CURVE}, output="y", options=Options(derivative=1))
    assert not asked.as_told(plain())
    assert MetricRequest(metric="max_velocity", signals={"r": S_CURVE}, output="v").as_told(mass())
    assert not MetricRequest(metric="max_velocity", signals={"r": S_CURVE}, output="x").as_told(mass())


def test_a_goal_without_it_is_refused_and_with_it_met() -> None:
    """The stiffest k whose largest velocity stays below 2.2."""

    def problem(**options: Any) -> Problem:
        limit = Goal(metric="max_velocity", experiment="move", output="y", upper=2.2, options=Options(**options))
        return Problem(
            diagram=plain(), variables=(Variable(parameter="k", lower=10.0, upper=80.0),),
            experiments=(Experiment(name="move", signals={"r": S_CURVE}),),
            goals=(Goal(metric="bandwidth", source="r", target="y", sense=Sense.MAXIMIZE), limit),
        )  # fmt: skip

    with pytest.raises(ProblemError, match="it needs 'derivative', as output y has no unit"):
        problem().requests  # noqa: B018 - checked where it is asked for
    found = minimize("gradient", problem(derivative=1), {"starts": 2, "seed": 1, "max_evaluations": 400})
    expected = brentq(lambda k: np.abs(motion(k, 3.0)[0]).max() - 2.2, 10.0, 80.0, xtol=1e-9)
    assert found.best["k"] == pytest.approx(expected, rel=1e-5)
    assert found.certificate.valid


def test_defaults_leave_out_what_is_not_known() -> None:
    found = simulate(plain(), signals={"r": S_CURVE})
    assert "max_velocity" not in found.metrics["y"]
    assert "control_effort" in found.metrics["effort"]


def late_loop(delay: float) -> Diagram:
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "c": block("pi", kp=0.6, ki=2.0), "d": block("delay", time="=T"),
        "g": block("transfer_function", numerator=[0.5], denominator=[0.2, 1.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "g -> e.in2", "e -> c", "c -> d", "d -> g"]
    return compile_system(document(blocks, wires, {"y": "g"}, T=delay))


def test_a_delay_of_zero_has_the_slope_that_it_has_beside_it() -> None:
    diagram = late_loop(0.0)
    step = {"r": make("step", {})}
    requests = [MetricRequest(metric=name, signals=step, output="y") for name in ("ise", "settling_time", "rise_time")]
    requests.append(MetricRequest(metric="phase_margin", open_at="e"))
    found = measure(diagram, requests, gradient=["T"])
    beside = [measure(diagram, requests, overrides={"T": h}) for h in (1e-4, 2e-4)]
    for (at_zero, gradient), (one, _), (two, _) in zip(found, *beside, strict=True):
        assert gradient is not None
        assert at_zero.value is not None
        # a difference to one side, right to second order
        expected = (4 * one.value - 3 * at_zero.value - two.value) / 2e-4
        assert gradient.values == pytest.approx([expected], rel=1e-5)


def test_a_search_whose_best_delay_is_zero_does_not_call_it_idle() -> None:
    made = Problem(
        diagram=late_loop(0.02),
        variables=(Variable(parameter="T", lower=0.0, upper=0.1),),
        experiments=(Experiment(name="step", signals={"r": make("step", {})}),),
        goals=(Goal(metric="ise", experiment="step", output="y", sense=Sense.MINIMIZE),),
    )
    result = minimize("grid", made, {"points": 5})
    assert result.best["T"] == 0.0
    assert not [warning for warning in result.warnings if "changes no goal" in warning]

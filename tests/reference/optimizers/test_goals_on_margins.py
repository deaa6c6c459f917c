"""Goals on margins and damping compare distances from instability, in whichever direction the nearest crossing lies.

The values are those of python-control or closed forms; what an optimum should be follows from them by looking along the variable.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import control
import numpy as np
import pytest

from engine.analysis.study import MetricRequest, measure
from engine.diagram.diagram import Diagram
from engine.model.verdicts import Verdict
from engine.signals import make
from optimizers.evaluation.certificate import certify
from optimizers.evaluation.evaluate import Evaluator
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from optimizers.search.result import Result, Status
from tests.reference.systems import block, system, unity_loop

FEW = {"starts": 3, "seed": 1, "max_evaluations": 600}
STEP = Experiment(name="step", signals={"r": make("step", {})})


def solved(diagram: Diagram, variable: Variable, *goals: Goal, **more: Any) -> Result:
    made = Problem(diagram=diagram, variables=(variable,), goals=goals, experiments=(STEP,), **more)
    return minimize("gradient", made, FEW)


def margin(metric: str = "gain_margin", **changes: Any) -> Goal:
    return Goal(metric=metric, open_at="error", **changes)


def conditionally_stable() -> Diagram:
    """kp (s + 2)² / s³: at ω = 2 rad/s the phase is -180 degrees and |L| = kp, so that kp may fall to 1 and rise for ever."""
    return unity_loop(["=kp", "=4*kp", "=4*kp"], [1, 0, 0, 0], kp=10.0)


KP = Variable(parameter="kp", lower=1.2, upper=30.0)


def test_the_largest_gain_margin_of_a_loop_that_only_bears_less_gain() -> None:
    result = solved(conditionally_stable(), KP, margin(sense=Sense.MAXIMIZE))
    assert result.status is Status.CONVERGED
    assert result.best["kp"] == pytest.approx(30.0)
    assert result.goals[0].after.value == pytest.approx(1 / 30)  # what is shown has its sign
    assert result.objective == pytest.approx(-30.0)


def test_a_lower_bound_of_a_gain_margin_is_a_distance() -> None:
    # a sluggish loop is wanted, which bears a halved gain: kp = 2
    least = margin("sensitivity_peak", sense=Sense.MAXIMIZE)
    result = solved(conditionally_stable(), KP, margin(lower=2.0), least)
    assert result.best["kp"] == pytest.approx(2.0, rel=1e-5)
    assert result.goals[0].met
    assert result.goals[0].active
    assert result.goals[0].score == pytest.approx(1.0, abs=1e-5)


def test_a_loop_with_room_on_both_sides_meets_its_bound() -> None:
    # kp (s + 2)² / (s³ (1e-3 s + 1)²): the gain may fall to 0.12 and rise 100 times and more
    numerator, denominator = [1.0, 4.0, 4.0], [1e-6, 2e-3, 1.0, 0.0, 0.0, 0.0]
    least, *_, most = np.sort(control.stability_margins(control.tf(numerator, denominator), returnall=True)[0])
    diagram = unity_loop(["=kp", "=4*kp", "=4*kp"], denominator, kp=least / 0.12)
    wanted = (margin(lower=2.0), margin("sensitivity_peak", sense=Sense.MINIMIZE))
    made = Problem(diagram=diagram, variables=(Variable(parameter="kp", lower=least, upper=most),), goals=wanted)
    found = Evaluator(made).assess(np.array([made.start()]))
    assert most * 0.12 / least > 1 / 0.12  # the reduction is the nearer one
    assert found.violation[0] == 0.0
    assert found.values[0, 0, 0] == pytest.approx(1 / 0.12, rel=1e-9)


DELAY = Variable(parameter="tau", lower=0.018, upper=0.023)


def resonant() -> Diagram:
    """10/s · 100²/(s² + 4 s + 100²) behind a delay."""
    return system(
        {
            "r": block("input"),
            "error": block("sum", signs="+-"),
            "plant": block("transfer_function", numerator=[1e5], denominator=[1, 4, 1e4, 0]),
            "late": block("delay", time="=tau"),
        },
        ["r -> error.in1", "late -> error.in2", "error -> plant", "plant -> late"],
        {"y": "late"},
        {"tau": 0.02},
    )


def phase_margins(tau: float) -> np.ndarray:
    """Return π + arg L in (-π, π] wherever |L| = 1: |ω (10⁴ - ω²) + 4 j ω²|² = 10¹⁰ does not depend on the delay."""
    squares = np.roots([1.0, 16.0 - 2e4, 1e8, -1e10])
    omega = np.sqrt(squares[(np.abs(squares.imag) < 1e-9 * np.abs(squares)) & (squares.real > 0)].real)
    response = 1e5 / ((1j * omega) ** 3 + 4 * (1j * omega) ** 2 + 1e4 * 1j * omega) * np.exp(-1j * omega * tau)
    return np.angle(-response)


def test_the_largest_phase_margin_of_a_loop_that_bears_more_phase() -> None:
    delays = np.linspace(DELAY.lower, DELAY.upper, 101)
    distances = np.array([np.abs(phase_margins(tau)).min() for tau in delays])
    result = solved(resonant(), DELAY, margin("phase_margin", sense=Sense.MAXIMIZE))
    assert result.status is Status.CONVERGED
    assert result.best["tau"] == pytest.approx(delays[distances.argmax()], rel=1e-6)
    assert result.objective == pytest.approx(-distances.max(), rel=1e-9)
    assert math.degrees(result.goals[0].after.value) == pytest.approx(-56.3, abs=0.05)
    proof = result.certificate.goals[0]
    assert proof.independent == pytest.approx(result.goals[0].after.value, rel=1e-9)


def test_the_delays_of_the_range_leave_the_loop_stable() -> None:
    # what the distances mean hangs on it: the poles with the delay as a Padé approximation of order 12
    for tau in (0.018, 0.0205, 0.023):
        loop = control.tf([1e5], [1, 4, 1e4, 0]) * control.tf(*control.pade(tau, 12))
        assert control.feedback(loop, 1).poles().real.max() < 0


def test_a_bound_of_a_phase_margin_is_a_distance() -> None:
    # 45 degrees to either side: that of the longest delay serves, 29 degrees does not
    result = solved(
        resonant(), DELAY, margin("phase_margin", lower=math.pi / 4), margin("delay_margin", sense=Sense.MAXIMIZE)
    )
    assert result.goals[0].met
    nearest = [tau for tau in np.linspace(0.018, 0.023, 5001) if np.abs(phase_margins(tau)).min() >= math.pi / 4]
    assert result.best["tau"] == pytest.approx(nearest[0], rel=1e-4)  # more delay leaves less to be added


@pytest.mark.parametrize(
    ("diagram", "parameter", "metric", "at"),
    [
        (conditionally_stable, "kp", "gain_margin", 5.0),
        (resonant, "tau", "phase_margin", 0.02),
        (resonant, "tau", "gain_margin", 0.02),
    ],
)
def test_slopes_of_distances_are_the_limit_of_differences(
    diagram: Callable[[], Diagram], parameter: str, metric: str, at: float
) -> None:
    variable = Variable(parameter=parameter, lower=0.5 * at, upper=2.0 * at)
    made = Problem(diagram=diagram(), variables=(variable,), goals=(margin(metric, sense=Sense.MAXIMIZE),))
    evaluator, middle, step = Evaluator(made), np.array([1 / 3]), 1e-5
    local = evaluator.local(middle)
    assert local is not None
    beside = evaluator.assess(np.array([middle + step, middle - step])).values[:, 0, 0]
    assert local.slopes[0, 0, 0] == pytest.approx((beside[0] - beside[1]) / (2 * step), rel=1e-5)
    assert local.values[0, 0] >= (1.0 if metric == "gain_margin" else 0.0)


def servo() -> Diagram:
    """kp / (s (s + 2)): 1 ± √(1 - kp) up to kp = 1, then a damping of 1/√kp."""
    return system(
        {
            "r": block("input"),
            "error": block("sum", signs="+-"),
            "controller": block("gain", gain="=kp"),
            "plant": block("transfer_function", numerator=[1], denominator=[1, 2, 0]),
        },
        ["r -> error.in1", "plant -> error.in2", "error -> controller", "controller -> plant"],
        {"y": "plant", "u": "controller"},
        {"kp": 1.0},
    )


def test_real_poles_are_damped_enough() -> None:
    least = Goal(metric="control_effort", experiment="step", output="u", sense=Sense.MINIMIZE)
    damped = Goal(metric="damping_ratio", lower=0.7)
    result = solved(servo(), Variable(parameter="kp", lower=0.05, upper=10.0), least, damped)
    assert result.status is Status.CONVERGED
    assert result.best["kp"] == pytest.approx(0.05)
    assert result.goals[1].after.value == 1.0
    assert result.certificate.goals[1].independent == 1.0


def test_damping_bounds_the_gain_from_above() -> None:
    most = Goal(metric="control_effort", experiment="step", output="u", sense=Sense.MAXIMIZE)
    damped = Goal(metric="damping_ratio", lower=0.7)
    result = solved(servo(), Variable(parameter="kp", lower=0.05, upper=10.0), most, damped)
    assert result.best["kp"] == pytest.approx(1 / 0.49, rel=1e-5)


def test_a_loop_on_the_stability_limit_has_no_margin_left() -> None:
    # kp = 1: s³ + s² + 4 s + 4 = (s² + 4)(s + 1), the limit exactly, at a frequency that is looked at
    wanted = [
        MetricRequest(metric=name, open_at="error") for name in ("gain_margin", "gain_margin_up", "gain_margin_down")
    ]
    for found, _ in measure(conditionally_stable(), wanted, overrides={"kp": 1.0}):
        assert found.value == pytest.approx(1.0, abs=1e-12)
        assert found.verdict is Verdict.MARGINAL
    made = Problem(
        diagram=conditionally_stable(), variables=(KP,), goals=(margin(lower=3.0), margin(sense=Sense.MAXIMIZE))
    )
    assert certify(made, {"kp": 1.0}).worst_violation == pytest.approx(2 / 3)

"""Gain margins in both directions, at both ends of the axis and far down, and the disk margin, against python-control."""

from __future__ import annotations

import math
from typing import Any

import control
import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import frequency_response
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from engine.model.verdicts import Verdict
from optimizers.independent_check import witnessed
from optimizers.problem import Goal, Problem, Sense, Variable
from tests.reference.systems import block, system, unity_loop

NAMES = ("gain_margin", "gain_margin_up", "gain_margin_down", "disk_margin")
REQUESTS = [MetricRequest(metric=name, open_at="error") for name in NAMES]


def read(diagram: Diagram, name: str, overrides: dict[str, float] | None = None) -> tuple[float | None, Verdict]:
    ((found, _),) = measure(diagram, [MetricRequest(metric=name, open_at="error")], overrides=overrides)
    return found.value, found.verdict


# stable loops: numerator, denominator
LOOPS = [
    ([10.0, 40.0, 40.0], [1.0, 0.0, 0.0, 0.0]),  # conditionally stable, bears any rise
    ([1.0], [1.0, 3.0, 3.0, 1.0]),  # bears 8 times the gain, and any fall
    ([2e2, 8e2, 8e2], [1e-6, 2e-3, 1.0, 0.0, 0.0, 0.0]),  # both ways
    ([4.0], [1.0, -1.0]),  # an unstable plant: L(0) = -4
    ([1.0], [1.0, 1.0]),  # neither
    ([3.0, 6.0], [1.0, 2.0, 5.0, 0.0]),
    ([1e3], [1.0, 0.4, 100.0, 0.0]),
]  # fmt: skip


@pytest.mark.parametrize(("numerator", "denominator"), LOOPS)
def test_gain_margins_are_those_of_python_control(numerator: list[float], denominator: list[float]) -> None:
    loop = control.tf(numerator, denominator)
    stable = control.feedback(loop, 1).poles().real.max() < 0
    gains = control.stability_margins(loop, returnall=True)[0]
    if denominator[-1] != 0 and numerator[-1] / denominator[-1] < 0:
        gains = np.append(gains, -denominator[-1] / numerator[-1])
    diagram = unity_loop(numerator, denominator)
    up, down = read(diagram, "gain_margin_up"), read(diagram, "gain_margin_down")
    if not stable:
        assert up == down == (None, Verdict.UNSTABLE)
        return
    above, below = gains[(gains > 1) & np.isfinite(gains)], gains[(gains < 1) & (gains > 1e-9)]
    assert up == ((pytest.approx(above.min(), rel=1e-9), Verdict.OK) if len(above) else (None, Verdict.NEVER_CROSSES))
    assert down == (pytest.approx(below.max() if len(below) else 0.0, rel=1e-9), Verdict.OK)


@pytest.mark.parametrize(("numerator", "denominator"), LOOPS)
def test_the_disk_margin_is_that_of_python_control_and_of_its_own_extremes(
    numerator: list[float], denominator: list[float]
) -> None:
    loop = control.tf(numerator, denominator)
    value, verdict = read(unity_loop(numerator, denominator), "disk_margin")
    if verdict is Verdict.UNSTABLE:
        return
    if not any(numerator[:-1]) and len(denominator) == 2:  # |1 - L| <= |1 + L| everywhere, and equal where L ends
        assert value == pytest.approx(2.0, rel=1e-12) or denominator[-1] < 0
    omega = np.geomspace(1e-4, 1e5, 200_001)
    margin, gain, phase = control.disk_margins(loop, omega, skew=0.0)
    assert value == pytest.approx(float(margin), rel=1e-5)
    # what it promises: gains and phases up to the ends of the disk
    if value < 1.999:
        assert (2 + value) / (2 - value) == pytest.approx(10 ** (float(np.max(gain)) / 20), rel=1e-3)
        assert math.degrees(2 * math.atan(value / 2)) == pytest.approx(float(np.max(phase)), rel=1e-4)


def test_the_disk_margin_of_an_integrator_and_of_a_lag_behind_it() -> None:
    # S - 1/2 = (s - k) / (2 (s + k)): 1/2 everywhere
    assert read(unity_loop(["=k"], [1, 0], k=3.0), "disk_margin")[0] == pytest.approx(2.0, rel=1e-9)
    # L = k / (s (s + 2)): |1 - L|² / |1 + L|² = ((k + ω²)² + 4 ω²) / ((k - ω²)² + 4 ω²), largest at ω² = k: (4 k² + 4 k)/(4 k)
    value, _ = read(unity_loop(["=k"], [1, 2, 0], k=3.0), "disk_margin")
    assert value == pytest.approx(2 / math.sqrt(1 + 3.0), rel=1e-9)


def test_margins_far_down_are_no_end_of_the_world() -> None:
    # 1 / (s (1e-8 s + 1)²): at ω = 1e8 |L| = 0.5e-8, so that the gain may rise 2e8 times
    fast = unity_loop([1], [1e-16, 2e-8, 1, 0])
    assert read(fast, "gain_margin") == (pytest.approx(2e8, rel=1e-9), Verdict.OK)
    study = frequency_response(fast, open_at="error")
    assert study.margins is not None
    assert study.margins.gain == ((pytest.approx(1e8, rel=1e-9), pytest.approx(2e8, rel=1e-9)),)
    assert study.margins.smallest_loop_gain < 1 / 2e8


@pytest.mark.parametrize("delay", [1e-5, 1e-3])
def test_margins_far_down_behind_a_delay(delay: float) -> None:
    # 1e-3/s e^{-s τ}: -180 degrees at ω = π / (2 τ) first
    diagram = system(
        {
            "r": block("input"), "error": block("sum", signs="+-"),
            "plant": block("transfer_function", numerator=["=k"], denominator=[1, 0]), "late": block("delay", time=delay),
        },
        ["r -> error.in1", "late -> error.in2", "error -> plant", "plant -> late"], {"y": "late"}, {"k": 1e-3},
    )  # fmt: skip
    expected = 1e3 * math.pi / (2 * delay)
    assert read(diagram, "gain_margin") == (pytest.approx(expected, rel=1e-9), Verdict.OK)
    assert read(diagram, "gain_margin_up")[0] == pytest.approx(expected, rel=1e-9)
    assert read(diagram, "gain_margin_down") == (0.0, Verdict.OK)


def test_what_rounding_draws_along_the_axis_is_no_crossing() -> None:
    # (s + 1e-3) / s² and a lag far away nears the axis and does not pass it
    for denominator in ([1, 0, 0], [1e-3, 1, 0, 0]):
        diagram = unity_loop([1, 1e-3], denominator)
        if read(diagram, "phase_margin")[1] is Verdict.OK:
            assert read(diagram, "gain_margin_up") == (None, Verdict.NEVER_CROSSES)


def test_a_loop_with_a_direct_gain_meets_its_limit_at_infinite_frequency() -> None:
    # L = -(0.5 s + 0.5) / (s + 2): 1 + k L has its root at -(2 - k/2) / (1 - k/2), which passes infinity at k = 2
    diagram = unity_loop([-0.5, -0.5], [1, 2])
    assert read(diagram, "gain_margin")[0] == pytest.approx(2.0, rel=1e-12)
    assert read(diagram, "gain_margin_up")[0] == pytest.approx(2.0, rel=1e-12)


def test_a_loop_on_the_stability_limit_bears_nothing() -> None:
    # 1 / (s (s + 1)²) times 2
    diagram = unity_loop([2], [1, 2, 1, 0])
    for name in ("gain_margin", "gain_margin_up", "gain_margin_down"):
        assert read(diagram, name)[0] == pytest.approx(1.0, abs=1e-9), name
    assert read(diagram, "delay_margin")[0] == pytest.approx(0.0, abs=1e-6)
    assert read(diagram, "disk_margin") == (None, Verdict.DIVERGES)


@pytest.mark.parametrize("k", [1.2, 2.5, 4.0])
def test_every_way_of_measuring_says_the_same(k: float) -> None:
    # exactly, by the compiled kernels, by a batched scan with slopes, and by the second measurement
    diagram = unity_loop(["=k", "=4*k", "=4*k"], [1e-6, 2e-3, 1, 0, 0, 0], k=2.0)
    exact = measure(diagram, REQUESTS, overrides={"k": k}, gradient=["k"])
    batch = Screening(diagram, REQUESTS)({"k": np.array([k + 1e-30j])})
    values = np.array([measured.value for measured, _ in exact])
    slopes = np.array([gradient.values[0] for _, gradient in exact if gradient is not None])
    assert batch.values[0].real == pytest.approx(values, rel=1e-7)
    assert batch.values[0].imag / 1e-30 == pytest.approx(slopes, rel=1e-5)
    assert Screening(diagram, REQUESTS)({"k": np.array([k])}).values[0] == pytest.approx(values, rel=1e-7)
    goals = tuple(Goal(metric=name, open_at="error", sense=Sense.MAXIMIZE) for name in NAMES)
    made = Problem(diagram=diagram, variables=(Variable(parameter="k", lower=1.0, upper=10.0),), goals=goals)
    statements = [None if s is None else s.value for s in witnessed(made, {"k": k}, {})]
    assert statements == pytest.approx(values.tolist(), rel=1e-7)


def test_compiled_kernels_leave_faint_crossings_to_the_exact_path() -> None:
    diagram = unity_loop(["=k"], [1e-16, 2e-8, 1, 0], k=1.0)
    found: Any = Screening(diagram, REQUESTS[:1])({"k": np.array([1.0])})
    assert np.isnan(found.values[0, 0]) == found.doubtful[0, 0]
    if not found.doubtful[0, 0]:
        assert found.values[0, 0] == pytest.approx(2e8, rel=1e-8)

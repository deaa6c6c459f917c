"""Back within an absolute band after a load, and settling within any band: against formulas and integrations by scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine.analysis.commanded import CommandParameter
from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from engine.model.errors import DiagramError
from engine.model.metric_options import Options
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.reference.systems import block, system


def speed_loop(**changed: float) -> Diagram:
    """r -> PI -> 1/(J s) -> speed, a load torque against it, a saturation that hardly acts."""
    blocks = {
        "r": block("input"), "load": block("input", role="disturbance"), "e": block("sum", signs="+-"),
        "c": block("pi", kp="=kp", ki="=ki"), "torque": block("sum", signs="+-"),
        "inertia": block("transfer_function", numerator=[1], denominator=["=J", 0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "inertia -> e.in2", "e -> c", "c -> torque.in1", "load -> torque.in2", "torque -> inertia"]
    return system(blocks, wires, {"speed": "inertia", "u": "c"}, {"kp": 2.0, "ki": 1.0, "J": 1.0} | changed)


def request(band: float = 0.05, *, amplitude: float = 1.0, start: float = 0.0, **fields) -> MetricRequest:
    signals = fields.pop("signals", {"load": make("step", {"amplitude": amplitude, "start": start})})
    return MetricRequest(
        metric="recovery_time", signals=signals, output="speed", options=Options(recovery_band=band), **fields
    )


def last_entry(band: float) -> float:
    """Of y = -t e^-t, the response to a unit load with kp 2, ki 1, J 1: the later root of t e^-t = band."""
    t = 3.0
    for _ in range(50):
        t -= (t * math.exp(-t) - band) / ((1 - t) * math.exp(-t))
    return t


def test_after_a_load_it_is_the_last_entry_into_the_absolute_band() -> None:
    ((found, gradient),) = measure(speed_loop(), [request()], gradient=["kp", "ki"])
    t = last_entry(0.05)
    assert (found.unit, found.verdict) == ("s", Verdict.OK)
    assert found.value == pytest.approx(t, rel=1e-10)
    # ∂y/∂p by differences of the closed form e^{at} sinh(bt)/b about the double pole: see the next test for the slopes
    assert gradient is not None
    assert gradient.values[0] != 0.0
    ((twice, _),) = measure(speed_loop(), [request(0.1, amplitude=2.0)])
    assert twice.value == pytest.approx(t, rel=1e-10)


@pytest.mark.parametrize("parameter", ["kp", "ki", "J"])
def test_its_slopes_are_those_of_converged_differences(parameter: str) -> None:
    diagram = speed_loop(kp=1.5)
    ((found, gradient),) = measure(diagram, [request(0.02)], gradient=[parameter])
    assert gradient is not None
    at = diagram.parameters[parameter].value

    def value(change: float) -> float:
        ((moved, _),) = measure(diagram, [request(0.02)], overrides={parameter: at + change})
        return float(moved.value)

    rough, fine = ((value(h) - value(-h)) / (2 * h) for h in (2e-3, 1e-3))
    assert found.value > 1
    assert gradient.values[0] == pytest.approx((4 * fine - rough) / 3, rel=1e-6)


def test_behind_a_reference_it_counts_from_the_load_and_from_where_the_output_was() -> None:
    # the reference has settled at 2 long before the load at 40 s
    both = {"r": make("step", {"amplitude": 2.0}), "load": make("step", {"start": 40.0})}
    ((found, _),) = measure(speed_loop(), [request(signals=both)])
    assert found.value == pytest.approx(last_entry(0.05), rel=1e-8)
    load = CommandParameter(signal=both["load"], path="start")
    amplitude = CommandParameter(signal=both["load"], path="amplitude")
    ((_, gradient),) = measure(speed_loop(), [request(signals=both)], gradient=[load, amplitude])
    assert gradient is not None
    assert gradient.values[0] == pytest.approx(0.0, abs=1e-8)
    t = last_entry(0.05)  # d/da of a t e^-t = band: -t e^-t / ((1 - t) e^-t)
    assert gradient.values[1] == pytest.approx(t / (t - 1), rel=1e-8)


def test_an_output_that_never_leaves_has_zero_and_one_that_never_comes_back_none() -> None:
    ((never, _),) = measure(speed_loop(), [request(0.5)])  # the largest deviation is 1/e
    assert (never.value, never.verdict) == (0.0, Verdict.OK)
    ((stays, _),) = measure(speed_loop(), [request(0.05)], overrides={"ki": 0.0})  # a droop of 1/kp
    assert (stays.value, stays.verdict) == (None, Verdict.NEVER_CROSSES)
    assert "0.5" in stays.advice
    assert "integral action" in stays.advice
    ramp = {"load": make("ramp", {"slope": 1.0})}
    ((_, _), (moving, _)) = measure(speed_loop(), [request(), request(signals=ramp)])
    assert moving.verdict is Verdict.NOT_APPLICABLE


def test_a_band_far_below_the_deviation_keeps_its_digits() -> None:
    ((found, _),) = measure(speed_loop(), [request(1e-9)])
    assert found.value == pytest.approx(last_entry(1e-9), rel=1e-9)


def test_of_a_nonlinear_loop_it_is_that_of_an_integration() -> None:
    blocks = {
        "load": block("input", role="disturbance"), "c": block("pi", kp=2.0, ki=1.0), "minus": block("gain", gain=-1.0),
        "limit": block("saturation", lower=-0.8, upper=0.8), "torque": block("sum", signs="+-"),
        "inertia": block("integrator"),
    }  # fmt: skip
    wires = [
        "inertia -> minus",
        "minus -> c",
        "c -> limit",
        "limit -> torque.in1",
        "load -> torque.in2",
        "torque -> inertia",
    ]
    diagram = system(blocks, wires, {"speed": "inertia"})
    pulse = {
        "load": make(
            "sampled",
            {"time": [0.0, 0.5, 1.0, 1.5, 60.0], "values": [0.0, 1.0, 1.0, 0.0, 0.0]},
        )
    }
    ((found, _),) = measure(diagram, [request(0.01, signals=pulse)])

    def rates(t: float, x: np.ndarray) -> list[float]:
        load = float(np.interp(t, [0.0, 0.5, 1.0, 1.5], [0.0, 1.0, 1.0, 0.0]))
        return [min(max(-2 * x[0] + x[1], -0.8), 0.8) - load, -x[0]]

    def outside(_t: float, x: np.ndarray) -> float:
        return abs(x[0]) - 0.01

    run = solve_ivp(rates, (0, 60), [0, 0], rtol=1e-11, atol=1e-13, max_step=0.05, events=outside)
    assert found.value == pytest.approx(run.t_events[0][-1], rel=1e-6)


@pytest.mark.parametrize("band", [0.001, 0.02, 0.05, 0.3])
def test_settling_is_asked_for_any_band(band: float) -> None:
    # 1/(s + a): ln(1/band)/a;  d/da = -ln(1/band)/a²
    diagram = system(
        {"u": block("input"), "lag": block("transfer_function", numerator=["=a"], denominator=[1, "=a"])},
        ["u -> lag"], {"y": "lag"}, {"a": 4.0},
    )  # fmt: skip
    asked = MetricRequest(
        metric="settling_time", signals={"u": make("step", {})}, output="y", options=Options(settling_band=band)
    )
    ((found, gradient),) = measure(diagram, [asked], gradient=["a"])
    assert found.value == pytest.approx(-math.log(band) / 4, rel=1e-10)
    assert gradient is not None
    assert gradient.values == pytest.approx([math.log(band) / 16], rel=1e-9)
    # what an optimiser looks at means the same band, in one batch with the usual one
    usual = MetricRequest(metric="settling_time", signals=asked.signals, output="y")
    a = np.array([1.0, 4.0, 30.0])
    screened = Screening(diagram, [asked, usual])({"a": a})
    assert not screened.doubtful.any()
    assert screened.values[:, 0] == pytest.approx(-math.log(band) / a, rel=1e-6)
    assert screened.values[:, 1] == pytest.approx(math.log(50) / a, rel=1e-6)


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"settling_band": 0.0}, "settling_band"), ({"settling_band": 1.0}, "settling_band"),
        ({"recovery_band": 0.0}, "recovery_band"), ({"recovery_band": math.inf}, "recovery_band"),
        ({"noise_density": -1.0}, "noise_density"), ({"noise_density": math.nan}, "noise_density"),
    ],
)  # fmt: skip
def test_numbers_out_of_range_are_refused_by_name(values: dict[str, float], name: str) -> None:
    with pytest.raises(DiagramError, match=f"{name} must be > 0") as error:
        Options(**values)
    assert error.value.at == (name,)


def test_without_its_band_it_says_what_is_missing() -> None:
    asked = MetricRequest(metric="recovery_time", signals={"load": make("step", {})}, output="speed")
    ((found, _),) = measure(speed_loop(), [asked])
    assert (found.value, found.verdict) == (None, Verdict.NOT_APPLICABLE)
    assert "recovery_band" in found.advice

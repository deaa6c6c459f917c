"""Discrete blocks: sample by sample against scipy, in loops against eigenvalues."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.signal import butter, dlsim, lfilter

from engine.analysis.evaluation import Evaluation
from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import simulate
from engine.diagram.diagram import Diagram, compile_system
from engine.model.errors import DiagramError
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

STEP = 0.01


def alone(kind: str, **values: Any) -> Diagram:
    return compile_system(document({"u": block("input"), "d": block(kind, **values)}, ["u -> d"], {"y": "d"}))


def samples(made: Diagram, delay: float = 0.0, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Return the input at the samples, and what the output is in the middle of what it holds."""
    signal = make("sine", {"amplitude": 1.5, "frequency": 40.0})
    found = simulate(made, signals={"u": signal}, duration=count * STEP, samples=count * 40 + 1, metrics=[])
    instants = STEP * np.arange(count)
    middle = np.rint((instants[:-1] + delay + 0.5 * STEP) / STEP * 40).astype(int)
    return np.asarray(signal.value(instants)).real[:-1], found.curves["y"][middle]


@pytest.mark.parametrize("delay", [0.0, 0.004])
@pytest.mark.parametrize(
    ("kind", "values", "numerator", "denominator"),
    [
        (
            "discrete_transfer_function",
            {"numerator": [0.5, -0.3, 0.1], "denominator": [2.0, -2.6, 0.9]},
            [0.5, -0.3, 0.1],
            [2.0, -2.6, 0.9],
        ),
        ("discrete_transfer_function", {"numerator": [0.4], "denominator": [1.0, -0.7]}, [0.0, 0.4], [1.0, -0.7]),
        ("discrete_transfer_function", {"numerator": [3.0], "denominator": [2.0]}, [1.5], [1.0]),
        ("discrete_integrator", {"gain": 2.0, "rule": "forward"}, [0.0, 2 * STEP], [1.0, -1.0]),
        ("discrete_integrator", {"gain": 2.0, "rule": "backward"}, [2 * STEP], [1.0, -1.0]),
        ("discrete_integrator", {"gain": 2.0, "rule": "trapezoidal"}, [STEP, STEP], [1.0, -1.0]),
    ],
)
def test_samples_are_those_of_scipy(kind, values, numerator, denominator, delay):
    u, y = samples(alone(kind, sample_time=STEP, delay=delay, **values), delay)
    np.testing.assert_allclose(y, lfilter(numerator, denominator, u), atol=1e-11)


def test_a_state_space_with_two_inputs_and_outputs():
    a, b, c, d = (
        [[0.8, 0.1], [-0.2, 0.7]],
        [[0.1, 0.0], [0.3, -0.2]],
        [[1.0, 0.0], [0.5, 1.0]],
        [[0.0, 0.1], [0.2, 0.0]],
    )
    made = compile_system(
        document(
            {"r": block("input"), "q": block("input"), "d": block("discrete_state_space", A=a, B=b, C=c, D=d, sample_time=STEP)},
            ["r -> d.in1", "q -> d.in2"], {"y1": "d.out1", "y2": "d.out2"},
        )
    )  # fmt: skip
    signals = {"r": make("sine", {"frequency": 30.0}), "q": make("ramp", {"slope": 2.0})}
    count = 50
    found = simulate(made, signals=signals, duration=count * STEP, samples=count * 20 + 1, metrics=[])
    t = STEP * np.arange(count)
    u = np.column_stack([np.sin(30 * t), 2 * t])
    _, expected, _ = dlsim((np.array(a), np.array(b), np.array(c), np.array(d), STEP), u)
    for k, name in enumerate(("y1", "y2")):
        np.testing.assert_allclose(found.curves[name][10 : count * 20 : 20], expected[:, k], atol=1e-11)


def test_a_notch_has_its_depth_at_its_frequency():
    """After the transient a sine at the notch frequency is left with the depth, at its samples."""
    w = 40.0
    made = alone("discrete_notch", frequency=w, depth=0.1, width=1.0, sample_time=STEP)
    found = simulate(
        made, signals={"u": make("sine", {"frequency": w})}, duration=4.0, samples=400 * 40 + 1, metrics=[]
    )
    held = found.curves["y"][300 * 40 + 20 :: 40]
    t = STEP * np.arange(300, 300 + len(held))
    basis = np.column_stack([np.sin(w * t), np.cos(w * t)])
    amplitude = np.hypot(*np.linalg.lstsq(basis, held, rcond=None)[0])
    assert amplitude == pytest.approx(0.1, rel=1e-6)
    with pytest.raises(DiagramError, match=r"sample_time of 0\.01 s, got 400"):
        alone("discrete_notch", frequency=400.0, sample_time=STEP)
    with pytest.raises(DiagramError, match="delay must be <= sample_time"):
        alone("discrete_integrator", sample_time=STEP, delay=0.02)
    with pytest.raises(DiagramError, match="at most of the order of the denominator"):
        alone("discrete_transfer_function", numerator=[1, 2, 3], denominator=[1, 2], sample_time=STEP)


def loop(kp: float, name: str) -> Diagram:
    """Return 1/(s (s + 2)) under kp (1 + 0.1/(z - 1)·...) as a transfer function or as blocks in parallel."""
    plant = {
        "r": block("input"),
        "e": block("sum", signs="+-"),
        "g": block("transfer_function", numerator=[1.0], denominator=[1.0, 2.0, 0.0]),
    }
    if name == "one":
        # kp + kp T/2 z/(z - 1)
        law = block(
            "discrete_transfer_function",
            numerator=[kp * (1 + 0.5 * STEP), -kp],
            denominator=[1.0, -1.0],
            sample_time=STEP,
        )
        return compile_system(
            document({**plant, "c": law}, ["r -> e.in1", "g -> e.in2", "e -> c", "c -> g"], {"y": "g"})
        )
    blocks = {
        **plant, "p": block("zero_order_hold", sample_time=STEP), "k": block("gain", gain=kp), "n": block("sum", signs="++"),
        "i": block("discrete_integrator", gain=0.5 * kp, sample_time=STEP),
    }  # fmt: skip
    wires = ["r -> e.in1", "g -> e.in2", "e -> p", "p -> k", "e -> i", "k -> n.in1", "i -> n.in2", "n -> g"]
    return compile_system(document(blocks, wires, {"y": "g"}))


@pytest.mark.parametrize("name", ["one", "several"])
def test_margins_of_a_loop_are_those_of_its_eigenvalues(name):
    kp = 20.0
    decay = np.exp(-2 * STEP)
    a = np.array([[1.0, (1 - decay) / 2], [0.0, decay]])
    b = np.array([[(STEP - (1 - decay) / 2) / 2], [(1 - decay) / 2]])

    def radius(factor: float) -> float:
        k = kp * factor
        whole = np.zeros((3, 3))
        whole[:2, :2] = a - b @ np.array([[k * (1 + 0.5 * STEP), 0.0]])
        whole[:2, 2:] = b
        whole[2, 0], whole[2, 2] = -k * 0.5 * STEP, 1.0
        return float(np.abs(np.linalg.eigvals(whole)).max())

    ((margin, _),) = measure(loop(kp, name), [MetricRequest(metric="gain_margin_up", open_at="e")])
    assert margin.verdict is Verdict.OK
    assert radius(margin.value * (1 - 1e-8)) < 1 < radius(margin.value * (1 + 1e-8))


def test_both_ways_of_writing_a_loop_respond_alike():
    one, several = (
        simulate(loop(20.0, name), signals={"r": make("step", {})}, duration=1.0, metrics=[]).curves["y"]
        for name in ("one", "several")
    )
    np.testing.assert_allclose(one, several, atol=1e-11)


@pytest.mark.parametrize("kind", ["zero_order_hold", "discrete_transfer_function"])
def test_the_first_sample_is_taken_at_the_offset(kind):
    law = {} if kind == "zero_order_hold" else {"numerator": [1.0], "denominator": [1.0]}
    made = alone(kind, sample_time=STEP, delay=0.002, offset=0.007, **law)
    signal = make("sine", {"amplitude": 1.5, "frequency": 40.0})
    found = simulate(made, signals={"u": signal}, duration=20 * STEP, samples=20_001, metrics=[])
    instants = np.concatenate([[-np.inf], 0.007 + STEP * np.arange(20)])
    times = np.arange(20_001) * 1e-5
    last = instants[np.searchsorted(instants, times - 0.002 + 1e-9) - 1]
    inside = np.abs((times - 0.009) / STEP - np.rint((times - 0.009) / STEP)) > 1e-3
    expected = np.where(np.isfinite(last), np.asarray(signal.value(np.where(np.isfinite(last), last, 0.0))).real, 0.0)
    np.testing.assert_allclose(found.curves["y"][inside], expected[inside], atol=1e-12)


def test_a_value_between_samples_moves_with_the_offset():
    made = alone("zero_order_hold", sample_time=STEP, offset=0.003)
    signal = make("sine", {"amplitude": 1.5, "frequency": 40.0})
    request = MetricRequest(metric="peak", output="y", signals={"u": signal}, duration=0.011)
    ((value, slopes),) = measure(made, [request], gradient=["d.offset"])
    assert value.value == pytest.approx(1.5 * np.sin(40.0 * 0.003), rel=1e-12)
    assert slopes.values[0] == pytest.approx(60.0 * np.cos(40.0 * 0.003), rel=1e-9)


def test_an_offset_of_a_sample_time_is_refused():
    with pytest.raises(DiagramError, match=r"offset must be < sample_time \(0.01 s\), got 0.01"):
        alone("zero_order_hold", sample_time=STEP, offset=STEP)


@pytest.mark.parametrize("order", [1, 2, 3, 8])
@pytest.mark.parametrize("design", ["low_pass", "high_pass"])
def test_a_butterworth_filter_is_that_of_scipy(design, order):
    corner = 60.0
    made = alone("discrete_filter", design=design, order=order, frequency=corner, sample_time=STEP)
    u, y = samples(made)
    b, a = butter(order, corner, design.replace("_pass", ""), fs=2 * np.pi / STEP)
    np.testing.assert_allclose(y, lfilter(b, a, u), atol=1e-9)


def test_a_lead_has_its_phase_at_the_mean_of_its_corners():
    """Tustin's rule warped at the mean: there the response is that of the continuous lead."""
    zero, pole, gain = 20.0, 180.0, 2.0
    made = alone(
        "discrete_filter", design="lead_lag", gain=gain, zero_frequency=zero, pole_frequency=pole, sample_time=STEP
    )
    u, y = samples(made)
    middle = 60.0
    k = middle / np.tan(0.5 * middle * STEP)
    b, a = np.array([1 + k / zero, 1 - k / zero]), np.array([1 + k / pole, 1 - k / pole])
    np.testing.assert_allclose(y, lfilter(gain * b, a, u), atol=1e-11)
    z = np.exp(1j * middle * STEP)
    exact = (1 + 1j * middle / zero) / (1 + 1j * middle / pole)
    assert np.polyval(b, z) / np.polyval(a, z) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"frequency": 400.0}, "frequency must be < 314.159 rad/s, the Nyquist frequency .*, got 400"),
        ({}, "frequency must be given for a low_pass"),
        ({"frequency": 10.0, "gain": 2.0}, "gain must be absent in a low_pass"),
        (
            {"design": "lead_lag", "frequency": 10.0, "zero_frequency": 1.0, "pole_frequency": 2.0},
            "frequency must be absent",
        ),
        ({"design": "lead_lag", "zero_frequency": 1.0}, "pole_frequency must be given for a lead_lag"),
    ],
)
def test_a_filter_that_is_none_is_refused(values, message):
    with pytest.raises(DiagramError, match=message):
        alone("discrete_filter", sample_time=STEP, **values)


def controlled(**values: Any) -> Diagram:
    """Return a loop round x' = u - x with a sampled PID of two inputs."""
    law = {"kp": 6.0, "ki": 9.0, "kd": 0.2, "filter_frequency": 60.0, "sample_time": 0.05, "delay": 0.02}
    two = "setpoint_weight_p" in values or "setpoint_weight_d" in values
    blocks = {
        "r": block("input"),
        "c": block("sampled_pid", **law | values),
        "p": block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0]),
    }
    if two:
        return compile_system(
            document(blocks, ["r -> c.reference", "p -> c.measurement", "c -> p"], {"y": "p", "u": "c"})
        )
    blocks["e"] = block("sum", signs="+-")
    return compile_system(document(blocks, ["r -> e.in1", "p -> e.in2", "e -> c", "c -> p"], {"y": "p", "u": "c"}))


def recursion(count: int, **values: Any) -> np.ndarray:
    """Return the plant's state at each sample, the law written out sample by sample."""
    given = {"setpoint_weight_p": 1.0, "setpoint_weight_d": 1.0, "derivative_rule": "backward", "form": "position",
             "upper": np.inf, "lower": -np.inf, "rate": np.inf, "anti_windup": "clamping", "tracking_time": 6 / 9} | values  # fmt: skip
    kp, ki, kd, w, step, late = 6.0, 9.0, 0.2, 60.0, 0.05, 0.02
    x = before = integral = derivative = last_d = last_v = held = 0.0
    found = []
    for _ in range(count):
        found.append(x)
        p, e, d = given["setpoint_weight_p"] - x, 1 - x, given["setpoint_weight_d"] - x
        if given["derivative_rule"] == "tustin":
            derivative = ((2 - w * step) * derivative + 2 * w * kd * (d - last_d)) / (2 + w * step)
        else:
            derivative = (derivative + w * kd * (d - last_d)) / (1 + w * step)
        last_d = d
        grown = integral + ki * step * e
        wanted = kp * p + grown + derivative
        if given["form"] == "increment":
            wanted, last_v, integral = before + wanted - last_v, wanted, grown
        limited = min(max(wanted, before - given["rate"] * step), before + given["rate"] * step)
        limited = min(max(limited, given["lower"]), given["upper"])
        if given["form"] == "position":
            if given["anti_windup"] == "back_calculation":
                integral = grown + step / given["tracking_time"] * (limited - wanted)
            elif given["anti_windup"] == "none" or not (wanted - limited) * (grown - integral) > 0:
                integral = grown
        before = limited
        x = held + (x - held) * np.exp(-late)
        held = limited
        x = held + (x - held) * np.exp(-(step - late))
    return np.array(found)


@pytest.mark.parametrize(
    "values",
    [
        {"setpoint_weight_p": 0.4, "setpoint_weight_d": 0.0},
        {"setpoint_weight_p": 0.7},
        {"derivative_rule": "tustin"},
        {"form": "increment"},
        {"form": "increment", "upper": 2.0, "rate": 20.0},
        {"form": "increment", "setpoint_weight_p": 0.3, "setpoint_weight_d": 0.0, "derivative_rule": "tustin"},
        {"upper": 2.0},
        {"upper": 2.0, "anti_windup": "none"},
        {"upper": 2.0, "anti_windup": "back_calculation"},
        {"upper": 2.0, "lower": -1.0, "anti_windup": "back_calculation", "tracking_time": 0.2},
        {"rate": 15.0},
        {"rate": 15.0, "upper": 3.0, "anti_windup": "back_calculation", "tracking_time": 0.3},
    ],
)
def test_a_sampled_pid_is_its_recursion(values):
    found = simulate(controlled(**values), signals={"r": make("step", {})}, duration=3.0, samples=61, metrics=[])
    np.testing.assert_allclose(found.curves["y"], recursion(61, **values), atol=1e-11)


def test_an_increment_without_limits_is_the_position_form():
    position, increment = (
        simulate(
            controlled(form=form, setpoint_weight_p=0.5), signals={"r": make("step", {})}, duration=3.0, metrics=[]
        )
        for form in ("position", "increment")
    )
    np.testing.assert_allclose(position.curves["y"], increment.curves["y"], atol=1e-11)


@pytest.mark.parametrize("values", [{}, {"form": "increment"}, {"setpoint_weight_p": 0.3}, {"upper": 2.0, "rate": 5.0}])
def test_forms_weights_and_limits_do_not_change_the_margins(values):
    wanted = [MetricRequest(metric=name, open_at="p") for name in ("gain_margin_up", "phase_margin")]
    expected = measure(controlled(), wanted)
    found = measure(controlled(**values), wanted)
    for (one, _), (other, _) in zip(found, expected, strict=True):
        assert one.value == pytest.approx(other.value, rel=1e-8)


@pytest.mark.parametrize(
    "values", [{}, {"form": "increment"}, {"setpoint_weight_p": 0.3}, {"derivative_rule": "tustin"}]
)
def test_an_unstable_loop_without_limits_is_called_unstable(values):
    made = controlled(kp=90.0, **values)
    assert made.sampled_alone
    found = simulate(made, signals={"r": make("step", {})}, duration=3.0, metrics=[])
    assert found.verdict is Verdict.UNSTABLE
    assert not any("limits" in remark.detail for remark in (*made.analysis, *found.warnings))


@pytest.mark.parametrize("values", [{"upper": 3.0}, {"rate": 5.0}, {"upper": 3.0, "anti_windup": "back_calculation"}])
def test_limits_of_a_sampled_pid_are_said(values):
    made = controlled(kp=90.0, **values)
    assert not made.sampled_alone
    assert any("c: its limits are left out" in remark.detail for remark in made.analysis)


@pytest.mark.parametrize(
    ("kind", "values", "pole"),
    [
        ("discrete_integrator", {}, 0.0),
        ("discrete_transfer_function", {"numerator": [1.0], "denominator": [1.0, -1.0]}, 0.0),
        ("discrete_transfer_function", {"numerator": [2.0, -1.7], "denominator": [2.0, -2.0]}, 0.0),
        ("sampled_pid", {"kp": 1.0, "ki": 2.0}, 0.0),
        ("sampled_pid", {"kp": 1.0, "ki": 2.0, "delay": 0.005}, 0.0),
        ("sampled_pid", {"kp": 1.0, "ki": 2.0, "form": "increment"}, 0.0),
        ("sampled_pid", {"kp": 1.0}, None),
        ("zero_order_hold", {"delay": 0.01}, None),
    ],
)
def test_a_sum_over_samples_is_an_integrator(kind, values, pole):
    blocks = {
        "u": block("input"),
        "d": block(kind, sample_time=STEP, **values),
        "g": block("transfer_function", numerator=[1.0], denominator=[0.1, 1.0]),
    }
    made = compile_system(document(blocks, ["u -> d", "d -> g"], {"y": "g"}))
    expected = [-10.0] if pole is None else [pole, -10.0]
    np.testing.assert_allclose(Evaluation(made).poles.values, expected, atol=1e-9)
    assert (Evaluation(made).poles.verdict is Verdict.OK) is (pole is None)


def test_slopes_by_a_weight_are_exact():
    wanted = [MetricRequest(metric="peak", signals={"r": make("step", {})}, output="y", duration=3.0)]
    made = controlled(setpoint_weight_p=0.9, derivative_rule="tustin", upper=5.0, anti_windup="back_calculation")
    names = ["c.setpoint_weight_p", "c.kp", "c.delay"]
    ((value, slopes),) = measure(made, wanted, gradient=names)
    assert value.verdict is Verdict.OK
    for k, name in enumerate(names):
        base, h = made.parameters[name].value, 1e-6
        sides = [measure(made, wanted, overrides={name: base * (1 + s * h)})[0][0].value for s in (1, -1)]
        assert slopes.values[k] == pytest.approx((sides[0] - sides[1]) / (2 * h * base), rel=1e-4)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"form": "increment", "ki": 0.0}, "ki must not be 0 in the increment form"),
        (
            {"form": "increment", "upper": 1.0, "anti_windup": "clamping"},
            "anti_windup must be absent in the increment form",
        ),
        ({"anti_windup": "back_calculation"}, "lower, upper or rate must be given for back_calculation"),
        ({"upper": 1.0, "tracking_time": 0.1}, "tracking_time must be absent unless"),
        ({"upper": 1.0, "ki": 0.0, "anti_windup": "back_calculation"}, "tracking_time must be given"),
        ({"upper": -1.0, "lower": 2.0}, "upper must be > lower"),
        ({"rate": 0.0}, "rate must be > 0"),
    ],
)
def test_a_sampled_pid_that_is_none_is_refused(values, message):
    with pytest.raises(DiagramError, match=message):
        controlled(**values)


@pytest.mark.parametrize("kind", ["zero_order_hold", "discrete_integrator"])
@pytest.mark.parametrize("wrong", [0.0, -0.01])
def test_a_sample_time_that_is_none_is_named_itself(kind, wrong):
    with pytest.raises(DiagramError, match=f"d.sample_time must be > 0 s, got {wrong:g}"):
        alone(kind, sample_time=wrong)


def test_the_last_point_of_a_curve_counts_the_sample_that_is_taken_there():
    found = simulate(
        alone("zero_order_hold", sample_time=0.1), signals={"u": make("ramp", {"slope": 1.0})}, duration=1.0, samples=21
    )
    np.testing.assert_allclose(found.curves["y"], np.floor(np.arange(21) / 2) / 10, atol=1e-12)

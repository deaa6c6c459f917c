"""Discrete blocks: sample by sample against scipy, in loops against eigenvalues."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.signal import dlsim, lfilter

from engine.diagram import Diagram, compile_system
from engine.errors import DiagramError
from engine.measuring import MetricRequest, measure
from engine.signals import make
from engine.study import simulate
from engine.verdicts import Verdict
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

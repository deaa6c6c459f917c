"""Nonlinear loops with pure delays: signals that jump through a delay, and exact derivatives, the delay's own included."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.evaluation import Evaluation
from engine.analysis.influence import Method, influence
from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import simulate
from engine.diagram.diagram import compile_system
from engine.exact.nonlinear.recorded import simulate_recorded
from engine.exact.nonlinear.ways import Ways
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document


def loop(law, time=1.2, initial=0.0, **more):
    """x' = law(r - x(t - time))."""
    return compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "s": law,
             "x": block("integrator", initial=initial), "d": block("delay", time=time)},
            ["r -> e.in1", "d -> e.in2", "e -> s", "s -> x", "x -> d"],
            {"y": "x", "e": "e", "w": "d", **more},
        )
    )  # fmt: skip


def request(metric, amplitude, duration, output="y"):
    signals = {"r": make("step", {"amplitude": amplitude})}
    return MetricRequest(metric=metric, signals=signals, output=output, duration=duration)


def test_a_signal_that_jumps_through_a_delay():
    """A step of 3 cut off at 2 jumps at 0.4 s, and again at 1.0 s behind the second delay; both outputs see the jump."""
    made = compile_system(
        document(
            {"r": block("input"), "s": block("saturation", lower=-2.0, upper=2.0), "d": block("delay", time=0.4),
             "b": block("dead_zone", lower=-0.5, upper=0.5), "f": block("delay", time=0.6)},
            ["r -> s", "s -> d", "d -> b", "b -> f"],
            {"d": "d", "f": "f"},
        )
    )  # fmt: skip
    found = simulate(made, signals={"r": make("step", {"amplitude": 3.0})}, duration=2.0, samples=21)
    assert found.verdict is Verdict.OK
    np.testing.assert_allclose(found.curves["d"], np.where(found.time >= 0.4, 2.0, 0.0), atol=1e-14)
    np.testing.assert_allclose(found.curves["f"], np.where(found.time >= 1.0, 1.5, 0.0), atol=1e-14)


def test_a_jump_goes_round_for_ever():
    """Without anything that smooths, w(t) = sat(1 - 0.9 w(t - τ)) jumps after every delay: w_k = 1 - 0.9 w_{k-1}."""
    made = compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "g": block("gain", gain=0.9),
             "s": block("saturation", lower=-5.0, upper=5.0), "d": block("delay", time=0.1)},
            ["r -> e.in1", "g -> e.in2", "e -> s", "s -> d", "d -> g"],
            {"w": "d"},
        )
    )  # fmt: skip
    found = simulate(made, signals={"r": make("step", {})}, duration=2.0, samples=201)
    levels = (1 - (-0.9) ** np.arange(21)) / 1.9
    inside = np.arange(201) % 10 != 0
    expected = levels[np.arange(201) // 10]
    np.testing.assert_allclose(found.curves["w"][inside], expected[inside], atol=1e-12)


def test_a_relay_behind_a_delay_with_its_slopes():
    """x' = 2 while the relay is high, -1 else: it sees x = 1 after the delay, so x turns at 1 + 2 τ and at 1 - τ."""
    made = loop(block("relay", low=-1.0, high=2.0), time=0.3, initial=0.1)
    values, slopes = measure(made, [request("peak", 1.0, 3.0)], gradient=["d.time", "s.high", "x.initial"])[0]
    assert values.value == pytest.approx(1.6, abs=1e-12)
    np.testing.assert_allclose(slopes.values, [2.0, 0.3, 0.0], atol=1e-11)
    curve = Evaluation(made).simulated({"r": make("step", {})}, 3.0).output("y")
    np.testing.assert_allclose(curve.sample(np.array([0.75, 1.65])), [1.6, 0.7], atol=1e-12)


def test_slopes_through_a_limit_that_is_left_after_a_delay():
    """x' = sat(r - x(t - τ)), limit u, x(0) = x0: x = x0 + u t until t1 = τ + (r - x0)/u - 1; peak u τ + r - u/2, 1 s later."""
    made = loop(block("saturation", lower=-2.0, upper=1.0), initial=0.1)
    names = ["d.time", "s.upper", "x.initial"]
    (peak, slopes), (at, later) = measure(
        made, [request("peak", 3.0, 4.35), request("peak_time", 3.0, 4.35)], gradient=names
    )
    assert peak.value == pytest.approx(3.7, abs=1e-12)
    np.testing.assert_allclose(slopes.values, [1.0, 0.7, 0.0], atol=1e-11)
    assert peak.at == pytest.approx(4.1, abs=1e-12)
    assert at.verdict is not Verdict.OK or np.allclose(later.values, [1.0, -2.9, -1.0], atol=1e-10)


def test_a_delay_that_vanishes_within_the_range_of_its_variable():
    """x' = sat(r - x(t - τ)), limit 1, r = 3: at τ = 0 a ramp for 2 s, then e^-(t - 2); the slope by the limit goes on."""
    made = loop(block("saturation", lower=-2.0, upper=1.0), time=0.05)
    asked = [request("ise", 3.0, 6.0)]
    (near, _), (none, slopes) = (
        measure(made, asked, overrides={"d.time": time}, gradient=["s.upper"])[0] for time in (0.05, 0.0)
    )
    assert none.value == pytest.approx(26 / 3 + (1 - np.exp(-8.0)) / 2, rel=1e-12)
    # u t until 3/u - 1, then 3 - u e^-(t - t1): dISE/du of ((27 - u³)/(3 u)) + u² (1 - e^-2(6 - 3/u + 1))/2 at u = 1
    assert slopes.values[0] == pytest.approx(-1 - 26 / 3 + (1 - np.exp(-8.0)) + 3 * np.exp(-8.0), rel=1e-11)
    assert near.value == pytest.approx(none.value, rel=2e-2)


@pytest.mark.parametrize("delay", [0.002, 0.05])
@pytest.mark.parametrize("law", ["saturation", "smooth", "stick"])
def test_influence_in_a_loop_with_a_delay(law, delay):
    """Exact derivatives by gains, limits and the delay itself agree with differences of the responses."""
    laws = {
        "saturation": block("saturation", lower=-2.5, upper=2.5),
        "smooth": block("friction", coulomb=2.0, viscous=0.5, transition_velocity=1.0),
        "stick": block("friction", coulomb=0.4, viscous=0.1),
    }
    made = compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "c": block("pi", kp=2.0, ki=1.0),
             "s": laws["saturation"] if law == "stick" else laws[law], "d": block("delay", time=delay),
             "n": block("sum", signs="+-"), "f": laws["stick" if law == "stick" else "smooth"],
             "v": block("integrator", gain=2.0)},
            ["r -> e.in1", "v -> e.in2", "e -> c", "c -> s", "s -> d", "d -> n.in1", "f -> n.in2", "n -> v", "v -> f"],
            {"y": "v"},
        )
    )  # fmt: skip
    duration = 0.15 if delay < 0.01 else 2.0
    asked = {"ise": request("ise", 2.0, duration)}
    names = ["c.kp", "d.time"]
    found = influence(made, asked, names).elasticities["ise"]
    for name in names:
        value, width = {"c.kp": 2.0, "d.time": delay}[name], 1e-4
        near = [
            measure(made, [asked["ise"]], overrides={name: value * (1 + side * width)})[0][0].value for side in (1, -1)
        ]
        expected = (near[0] - near[1]) / (width * (near[0] + near[1]))
        assert (found[name].method, found[name].verdict) == (Method.EXACT, Verdict.OK)
        assert found[name].value == pytest.approx(expected, rel=2e-6, abs=1e-7)


def axis(delay, limit):
    """Two inertias on a shaft, a PID controller with a limited torque behind a delay."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"),
        "c": block("pid", kp=2.0, ki=5.0, kd=0.04, filter_frequency=2000.0), "d": block("delay", time=delay),
        "motor": block("transfer_function", numerator=[1.0], denominator=[0.002, 0.01]), "x": block("integrator"),
        "twist": block("sum", signs="+-"), "k": block("gain", gain=400.0), "torque": block("sum", signs="+-"),
        "load": block("transfer_function", numerator=[1.0], denominator=[0.004, 0.004]), "y": block("integrator"),
    }  # fmt: skip
    wires = ["r -> e.in1", "x -> e.in2", "e -> c", "d -> torque.in1", "k -> torque.in2", "torque -> motor", "motor -> x",
             "x -> twist.in1", "y -> twist.in2", "twist -> k", "k -> load", "load -> y"]  # fmt: skip
    if limit is None:
        return compile_system(document(blocks, [*wires, "c -> d"], {"y": "y", "x": "x"}))
    blocks["s"] = block("saturation", lower=-limit, upper=limit)
    return compile_system(document(blocks, [*wires, "c -> s", "s -> d"], {"y": "y", "x": "x"}))


def test_steps_may_be_longer_than_a_delay():
    """How many there are follows from the response, not from the delay: one of 10 µs takes no more than one of 3 ms."""
    signals = {"r": make("step", {})}
    long, short = (Evaluation(axis(delay, 1.0)).simulated(signals, 1.0).outcome for delay in (3e-3, 1e-5))
    assert (long.verdict, short.verdict) == (Verdict.OK, Verdict.OK)
    assert short.events == long.events > 0
    assert short.steps <= long.steps < 300


@pytest.mark.parametrize(
    "command", [{"kind": "step"}, {"kind": "ramp", "slope": 2.0}, {"kind": "sine", "frequency": 30.0}]
)
def test_a_limit_that_is_never_reached_changes_nothing(command):
    """Steps of many delays each against the exact response of the linear loop, with the slopes by a gain and by the delay."""
    kind = dict(command)
    asked = [
        MetricRequest(
            metric=metric, signals={"r": make(kind.pop("kind", command["kind"]), kind)}, output="y", duration=0.5
        )
        for metric in ("peak", "control_effort_rms", "itae")
    ]
    free, limited = (measure(axis(1e-3, limit), asked, gradient=["c.kp", "d.time"]) for limit in (None, 1e6))
    for (known, exact), (found, slopes) in zip(free, limited, strict=True):
        assert found.value == pytest.approx(known.value, rel=1e-10)
        np.testing.assert_allclose(slopes.values, exact.values, rtol=1e-7, atol=1e-9 * np.abs(exact.values).max())


def test_a_state_of_rest_has_its_delayed_signals():
    """e = r - y(t - τ) comes to rest inside a dead zone, wherever it happens to: at its end, not where a dead zone begins."""
    made = compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "late": block("delay", time=0.28),
             "c": block("transfer_function", numerator=[0.1 * 7.8, 7.8], denominator=[0.01, 1.0]),
             "zone": block("dead_zone", lower=-0.005, upper=0.01),
             "x": block("transfer_function", numerator=[2.1], denominator=[1.0, 4.3, 0.0])},
            ["r -> e.in1", "late -> e.in2", "e -> c", "c -> zone", "zone -> x", "x -> late"],
            {"y": "x", "v": "zone"},
        )
    )  # fmt: skip
    signals = {"r": make("step", {"amplitude": 1.16})}
    found, later = (Evaluation(made).simulated(signals, duration) for duration in (None, 100.0))
    (end,) = later.output("y").sample(np.array([100.0]))
    assert found.finals["y"] == pytest.approx([end], rel=1e-6)
    assert found.finals["v"] == pytest.approx([0.0], abs=1e-12)


def test_a_recording_that_begins_at_rest_goes_on_there():
    """What went into the delays before the first sample is what goes in at rest: 2 s of y = 3/4 r, not a transient."""
    made = compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "late": block("delay", time=0.3),
             "s": block("saturation", lower=-2.0, upper=2.0), "y": block("transfer_function", numerator=[3.0], denominator=[0.5, 1.0])},
            ["r -> e.in1", "late -> e.in2", "e -> s", "s -> y", "y -> late"],
            {"y": "y"},
        )
    )  # fmt: skip
    values, tangents = simulate_recorded(
        made.laws(None, {"s.upper": 1e-30, "late.time": 1e-30}), np.full((1, 21), 1.6), 0.1
    )
    np.testing.assert_allclose(values, 1.2, rtol=1e-12)
    np.testing.assert_allclose(tangents, 0.0, atol=1e-10)


def sampled_axis(delay):
    """A sampled PID controller with limits, a delay of its own and one behind it."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "d": block("delay", time=delay),
        "c": block("sampled_pid", kp=2.0, ki=5.0, kd=0.04, filter_frequency=500.0, sample_time=0.01, delay=0.005,
                   upper=3.0, lower=-3.0),
        "motor": block("transfer_function", numerator=[1.0], denominator=[0.004, 0.02]), "x": block("integrator"),
    }  # fmt: skip
    wires = ["r -> e.in1", "x -> e.in2", "e -> c", "c -> d", "d -> motor", "motor -> x"]
    return compile_system(document(blocks, wires, {"y": "x"}))


def test_what_comes_out_of_a_delay_goes_no_further_than_the_next_sampler():
    """Each of 50 samples changes the output once, and that comes out of the delay once: four instants a sample, with its own."""
    found = Evaluation(sampled_axis(0.0013)).simulated({"r": make("step", {})}, 0.5).outcome
    assert found.verdict is Verdict.OK
    assert found.steps < 5 * 50


def test_which_delays_a_change_goes_on_into():
    made = compile_system(
        document(
            {"r": block("input"), "q": block("input"), "e": block("sum", signs="+-"), "a": block("delay", time=0.1),
             "h": block("zero_order_hold", sample_time=0.05), "b": block("delay", time=0.2), "x": block("integrator"),
             "s": block("saturation"), "f": block("sum", signs="++"), "c": block("delay", time=0.3)},
            ["r -> e.in1", "x -> e.in2", "e -> a", "a -> h", "h -> b", "b -> f.in1", "q -> f.in2", "f -> s", "s -> x", "x -> c"],
            {"y": "c"},
        )
    )  # fmt: skip
    ways = Ways(made.laws())
    order = [float(delay) for delay in made.laws().delays[0].real]
    into = dict(zip([law.label for law in made.laws().laws], ways.from_laws, strict=True))

    def times(flags):
        return {delay for delay, flag in zip(order, flags, strict=True) if flag}

    assert times(ways.from_commands) == {0.1, 0.3}  # r at once, q by way of the saturation and the integrator
    assert times(into["h"]) == {0.2}
    assert times(into["s"]) == {0.1, 0.3}
    assert [times(ways.from_delays[order.index(delay)]) for delay in (0.1, 0.2, 0.3)] == [set(), {0.1, 0.3}, set()]

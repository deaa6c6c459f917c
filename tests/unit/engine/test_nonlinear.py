"""Nonlinear blocks in diagrams: against closed solutions, at events exactly, linear ones as the linear engine has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from engine.analysis.influence import influence
from engine.analysis.measuring import MetricRequest
from engine.analysis.study import Simulation, frequency_response, simulate
from engine.diagram.diagram import Block, Diagram, compile_system
from engine.model.errors import IllPosedError
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

STEP = make("step", {})


def diagram(blocks: Mapping[str, Block], wires: Sequence[str], outputs: Mapping[str, str]) -> Diagram:
    return compile_system(document({"r": block("input"), **blocks}, wires, outputs))


def run(made: Diagram, duration: float | None, kind: str = "step", **values: Any) -> Simulation:
    return simulate(made, signals={"r": make(kind, values)}, duration=duration)


def static(kind: str, **values: Any) -> Diagram:
    return diagram({"law": block(kind, **values)}, ["r -> law"], {"y": "law", "u": "r"})


def test_saturated_integrator():
    """x' = sat(3 - x): x = t up to the limit's end at t = 2, then 3 - e^-(t-2)."""
    made = diagram(
        {"e": block("sum", signs="+-"), "s": block("saturation"), "x": block("integrator")},
        ["r -> e.in1", "x -> e.in2", "e -> s", "s -> x"],
        {"y": "x", "u": "s"},
    )
    found = run(made, 6.0, amplitude=3.0)
    t = found.time
    np.testing.assert_allclose(found.curves["y"], np.where(t < 2, t, 3 - np.exp(2 - t)), atol=1e-11)
    assert found.curves["u"].max() <= 1.0
    whole = run(made, None, amplitude=3.0)
    assert whole.verdict is Verdict.OK
    # 10 % at t = 0.3; 90 % at 3 - e^-(t-2) = 2.7
    assert whole.metrics["y"]["rise_time"].value == pytest.approx(2 - np.log(0.3) - 0.3, abs=1e-10)
    assert whole.metrics["y"]["settling_time"].value == pytest.approx(2 - np.log(0.06), abs=1e-9)


def loop(limited: bool) -> Diagram:
    blocks = {
        "e": block("sum", signs="+-"),
        "c": block("pid", kp=0.01, ki=0.002, kd=0.0005, filter_frequency=100.0),
        "m": block("linear_pneumatic_motor"),
    }
    wires = ["r -> e.in1", "m.position -> e.in2", "e -> c"]
    if not limited:
        return diagram(blocks, [*wires, "c -> m.flow"], {"y": "m.position"})
    # what a small signal passes through without being changed
    blocks |= {
        "s": block("saturation", lower=-9.0, upper=9.0),
        "l": block("rate_limiter", rising=1e9),
        "t": block("lookup_table", points=[-50.0, 50.0], values=[-50.0, 50.0]),
    }
    return diagram(blocks, [*wires, "c -> s", "s -> l", "l -> t", "t -> m.flow"], {"y": "m.position"})


def test_inside_its_limits_a_nonlinear_loop_is_the_linear_one():
    linear, nonlinear = run(loop(limited=False), 12.0), run(loop(limited=True), 12.0)
    np.testing.assert_allclose(nonlinear.curves["y"], linear.curves["y"], atol=1e-9)
    exact, found = run(loop(limited=False), None), run(loop(limited=True), None)
    for name, metric in exact.metrics["y"].items():
        assert found.metrics["y"][name].value == pytest.approx(metric.value, rel=1e-8, abs=1e-12), name


def test_a_command_that_just_reaches_a_limit():
    """x' = sat(r - x) with r = 1 and a limit of 1: no more than touched, x = 1 - e^-t."""
    made = diagram(
        {"e": block("sum", signs="+-"), "s": block("saturation"), "x": block("integrator")},
        ["r -> e.in1", "x -> e.in2", "e -> s", "s -> x"],
        {"y": "x"},
    )
    found = run(made, 3.0, amplitude=1.0)
    assert found.verdict is Verdict.OK
    np.testing.assert_allclose(found.curves["y"], 1 - np.exp(-found.time), atol=1e-10)


def test_a_nonlinear_loop_is_linearised_about_its_operating_point():
    ask = {"source": "r", "target": "y", "frequencies": np.array([0.1, 1.0, 20.0])}
    linear = frequency_response(loop(limited=False), **ask)
    found = frequency_response(loop(limited=True), **ask)
    np.testing.assert_allclose(found.response, linear.response, rtol=1e-10)
    assert any("linearised about its operating point" in remark.detail for remark in found.warnings)


@pytest.mark.parametrize(
    ("kind", "values", "law"),
    [
        ("saturation", {"lower": -0.5, "upper": 0.8}, lambda u: np.clip(u, -0.5, 0.8)),
        ("dead_zone", {"lower": -0.5, "upper": 0.3}, lambda u: u - np.clip(u, -0.5, 0.3)),
        ("quantizer", {"step": 0.3}, lambda u: 0.3 * np.round(u / 0.3)),
        ("lookup_table", {"points": [-1.0, 0.1, 0.5], "values": [2.0, 0.0, 1.0]},
         lambda u: np.interp(u, [-1.0, 0.1, 0.5], [2.0, 0.0, 1.0])),
        ("lookup_table", {"points": [-0.5, 0.1, 0.5], "values": [2.0, 0.0, 1.0], "extrapolation": "linear"},
         lambda u: np.where(u < 0.1, (0.1 - u) / 0.3, (u - 0.1) / 0.4)),
        ("friction", {"coulomb": 5.0, "static": 9.0, "viscous": 0.5, "viscous_negative": 2.0},
         lambda u: 5 * np.sign(u) + np.where(u > 0, 0.5, 2.0) * u),
        ("friction", {"coulomb": 5.0, "static": 9.0, "stribeck_velocity": 0.2},
         lambda u: np.sign(u) * (5 + 4 * np.exp(-((u / 0.2) ** 2)))),
    ],
)  # fmt: skip
def test_static_law(kind, values, law):
    found = run(static(kind, **values), 5.0, "sine", amplitude=1.0, frequency=2.0)
    np.testing.assert_allclose(found.curves["y"][1:], law(found.curves["u"][1:]), atol=1e-10)


def test_product_and_quotient():
    made = diagram(
        {"p": block("multiplication", operations="**/"), "b": block("gain", gain=0.1), "one": block("sum", signs="++"),
         "x": block("integrator", gain=0.0, initial=1.0)},
        ["r -> p.in1", "r -> p.in2", "r -> b", "b -> one.in1", "x -> one.in2", "one -> p.in3"],
        {"y": "p", "u": "r"},
    )  # fmt: skip
    found = run(made, 3.0, "sine", amplitude=2.0, frequency=3.0)
    u = found.curves["u"]
    np.testing.assert_allclose(found.curves["y"], u**2 / (1 + 0.1 * u), atol=1e-10)


def test_relay_with_hysteresis_swings_with_the_period_of_the_closed_solution():
    """x' = -x - y, y = ±1 switching at ±a: half a period is ln((1 + a)/(1 - a))."""
    made = diagram(
        {"k": block("relay", hysteresis=0.4), "n": block("sum", signs="+-"),
         "p": block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0])},
        ["r -> n.in1", "k -> n.in2", "n -> p", "p -> k"],
        {"y": "p", "u": "k"},
    )  # fmt: skip
    found = simulate(made, signals={"r": make("step", {"amplitude": 0.0})}, duration=8.0, samples=80_001)
    switches = found.time[1:][np.abs(np.diff(found.curves["u"])) > 1]
    np.testing.assert_allclose(np.diff(switches), np.log(1.2 / 0.8), atol=2.1e-4)
    assert np.abs(found.curves["y"]).max() == pytest.approx(0.2, abs=1e-4)
    whole = run(made, None, amplitude=0.0)
    assert whole.verdict is Verdict.NOT_SETTLED
    assert whole.metrics["y"]["peak"].value == pytest.approx(0.2, abs=1e-12)
    assert whole.metrics["y"]["rise_time"].verdict is Verdict.NOT_SETTLED


def test_relay_without_hysteresis_slides():
    """x' = r - 2 sign(x): for |r| < 2 the state stays exactly 0 and the relay's mean value is r."""
    made = diagram(
        {"k": block("relay", low=-2.0, high=2.0), "n": block("sum", signs="+-"), "x": block("integrator", initial=1.0)},
        ["r -> n.in1", "k -> n.in2", "n -> x", "x -> k"],
        {"y": "x", "u": "k"},
    )
    found = run(made, 4.0, "sine", amplitude=1.5, frequency=3.0)
    assert found.verdict is Verdict.OK
    # 1 + 0.5 (1 - cos 3t) - 2t = 0 at t = 0.9768...: Newton on the closed solution
    t0 = 0.9
    for _ in range(50):
        t0 -= (1 + 0.5 * (1 - np.cos(3 * t0)) - 2 * t0) / (1.5 * np.sin(3 * t0) - 2)
    before = found.time < t0
    t = found.time[before]
    np.testing.assert_allclose(found.curves["y"][before], 1 + 0.5 * (1 - np.cos(3 * t)) - 2 * t, atol=1e-11)
    assert np.all(found.curves["y"][~before] == 0.0)
    np.testing.assert_allclose(found.curves["u"][~before], 1.5 * np.sin(3 * found.time[~before]), atol=1e-10)


def test_quantizer_in_a_loop_slides_along_an_edge():
    """x' = 1 - q(x) comes to rest at the edge 1.05 between the levels 0.9 and 1.2, their mean being 1."""
    made = diagram(
        {"q": block("quantizer", step=0.3), "n": block("sum", signs="+-"), "x": block("integrator")},
        ["r -> n.in1", "q -> n.in2", "n -> x", "x -> q"],
        {"y": "x", "q": "q"},
    )
    found = run(made, 6.0)
    assert found.curves["y"][-1] == pytest.approx(1.05, abs=1e-12)
    assert found.curves["q"][-1] == pytest.approx(1.0, abs=1e-12)


def sliding_mass(**friction: float) -> Diagram:
    return diagram(
        {"n": block("sum", signs="+-"), "v": block("integrator", gain=1 / 2.0, initial=3.0), "x": block("integrator"),
         "f": block("friction", **friction)},
        ["r -> n.in1", "f -> n.in2", "n -> v", "v -> f", "v -> x"],
        {"x": "x", "v": "v", "f": "f"},
    )  # fmt: skip


def test_a_sliding_mass_comes_to_rest_and_stays_exactly_there():
    """2 v' = -5 - 4 v: v = (3 + 5/4) e^-2t - 5/4, at rest from t = ln(17/5)/2 on."""
    found = run(sliding_mass(coulomb=5.0, viscous=4.0), 2.0, amplitude=0.0)
    t, stop = found.time, np.log(17 / 5) / 2
    np.testing.assert_allclose(found.curves["v"], np.where(t < stop, 4.25 * np.exp(-2 * t) - 1.25, 0.0), atol=1e-11)
    assert np.all(found.curves["v"][t > stop] == 0.0)
    assert np.all(found.curves["f"][t > stop] == 0.0)
    # kinetic energy 9 J = ∫ f v dt: the friction takes all of it
    energy = np.trapezoid(found.curves["f"] * found.curves["v"], t)
    assert energy == pytest.approx(9.0, abs=1e-4)


def test_sticking_lasts_until_the_static_friction_is_reached():
    """A mass at rest under F = 2 t breaks away at F_s = 8, t = 4, then 2 v' = 2 t - 5."""
    made = diagram(
        {
            "n": block("sum", signs="+-"),
            "v": block("integrator", gain=0.5),
            "f": block("friction", coulomb=5.0, static=8.0),
        },
        ["r -> n.in1", "f -> n.in2", "n -> v", "v -> f"],
        {"v": "v", "f": "f"},
    )
    found = run(made, 6.0, "ramp", slope=2.0)
    t = found.time
    assert np.all(found.curves["v"][t < 4] == 0.0)
    np.testing.assert_allclose(found.curves["f"][t < 4], 2 * t[t < 4], atol=1e-12)
    moved = (t**2 / 2 - 2.5 * t) - (8 - 10)
    np.testing.assert_allclose(found.curves["v"][t > 4], moved[t > 4], atol=1e-10)


def test_elasticities_pass_through_events():
    """The stopping distance m v0²/(2 F_c) of a sliding mass: elasticity -1 in F_c; 1 in the mass, which is 1/gain."""
    requests = {"peak": MetricRequest(metric="peak", signals={"r": make("step", {"amplitude": 0.0})}, output="x")}
    found = influence(sliding_mass(coulomb=5.0), requests, ["f.coulomb", "v.gain", "v.initial"])
    assert found.base["peak"].value == pytest.approx(2 * 9 / 10, abs=1e-11)
    row = found.elasticities["peak"]
    assert [row[p].value for p in ("f.coulomb", "v.gain", "v.initial")] == pytest.approx([-1, -1, 2], abs=1e-9)


def test_backlash_follows_at_its_flanks():
    found = run(static("backlash", width=0.5), 6.0, "sine", amplitude=1.0, frequency=1.0)
    t, u, y = found.time, found.curves["u"], found.curves["y"]
    np.testing.assert_allclose(y[(t > 0.3) & (t < 1.57)], u[(t > 0.3) & (t < 1.57)] - 0.25, atol=1e-11)
    # it rests at 0.75 until sin t = 0.5 on the way down
    rests = (t > 1.58) & (t < np.pi - np.pi / 6)
    np.testing.assert_allclose(y[rests], 0.75, atol=1e-11)
    falls = (t > np.pi - np.pi / 6 + 0.01) & (t < 4.71)
    np.testing.assert_allclose(y[falls], u[falls] + 0.25, atol=1e-11)


def test_backlash_keeps_what_a_jump_leaves():
    made = static("backlash", width=0.5)
    signal = make("sampled", {"time": [0.0, 1.0, 1.000001, 2.0], "values": [0.0, 1.0, 0.6, 0.6]})
    found = simulate(made, signals={"r": signal}, duration=3.0)
    assert found.curves["y"][-1] == pytest.approx(0.75, abs=1e-11)
    assert run(made, 1.0, amplitude=-2.0).curves["y"][-1] == pytest.approx(-1.75, abs=1e-12)


def test_rate_limiter():
    found = run(static("rate_limiter", rising=1.0, falling=0.5), 8.0, amplitude=2.0, start=1.0)
    np.testing.assert_allclose(found.curves["y"], np.clip(found.time - 1, 0, 2), atol=1e-11)
    found = run(static("rate_limiter", rising=0.8), 6.0, "sine", amplitude=1.0, frequency=1.0)
    t = found.time
    # it leaves the sine at t = 0 already (slope 1), and meets it again where sin t = 0.8 t: 1.1311...
    early = t < 1.13
    np.testing.assert_allclose(found.curves["y"][early], 0.8 * t[early], atol=1e-11)
    assert np.abs(np.diff(found.curves["y"]) / np.diff(t)).max() <= 0.8 * (1 + 1e-9)
    slow = run(static("rate_limiter", rising=1.0), 6.0, "sine", amplitude=0.9, frequency=1.0)
    np.testing.assert_allclose(slow.curves["y"], slow.curves["u"], atol=1e-12)


@pytest.mark.parametrize("delay", [0.0, 0.03])
def test_sampled_loop(delay):
    """x' = 4 (1 - x_k) between samples: x_{k+1} = x_k + 4 (τ e_{k-1} + (T - τ) e_k)."""
    made = diagram(
        {"e": block("sum", signs="+-"), "h": block("zero_order_hold", sample_time=0.1, delay=delay),
         "x": block("integrator", gain=4.0)},
        ["r -> e.in1", "x -> e.in2", "e -> h", "h -> x"],
        {"y": "x"},
    )  # fmt: skip
    found = simulate(made, signals={"r": STEP}, duration=3.0, samples=31)
    expected, before = [0.0], 0.0
    for _ in range(30):
        error = 1 - expected[-1]
        expected.append(expected[-1] + 4 * (delay * before + (0.1 - delay) * error))
        before = error
    np.testing.assert_allclose(found.curves["y"], expected, atol=1e-12)


def test_sampled_pid_against_its_recursion():
    """The plant x' = u - x between samples: x -> u + (x - u) e^-h; the law as its docstring has it."""
    kp, ki, kd, w, step, late, top = 6.0, 9.0, 0.2, 80.0, 0.05, 0.02, 4.0
    made = diagram(
        {"e": block("sum", signs="+-"),
         "c": block("sampled_pid", kp=kp, ki=ki, kd=kd, filter_frequency=w, sample_time=step, delay=late, upper=top),
         "p": block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0])},
        ["r -> e.in1", "p -> e.in2", "e -> c", "c -> p"],
        {"y": "p", "u": "c"},
    )  # fmt: skip
    found = simulate(made, signals={"r": STEP}, duration=2.0, samples=41)
    x, u, integral, last, derivative, expected = 0.0, 0.0, 0.0, 0.0, 0.0, []
    for _ in range(41):
        expected.append(x)
        error = 1 - x
        derivative = (derivative + w * kd * (error - last)) / (1 + w * step)
        wanted = kp * error + integral + ki * step * error + derivative
        if not (wanted > top and error > 0):
            integral += ki * step * error
        x = u + (x - u) * np.exp(-late)
        u, last = min(wanted, top), error
        x = u + (x - u) * np.exp(-(step - late))
    np.testing.assert_allclose(found.curves["y"], expected, atol=1e-12)
    assert found.curves["u"].max() <= top
    whole = run(made, None)
    assert whole.metrics["y"]["steady_state_error"].value == pytest.approx(0.0, abs=1e-9)


def test_a_sampled_loop_knows_its_final_value():
    made = diagram(
        {"e": block("sum", signs="+-"), "h": block("zero_order_hold", sample_time=0.1),
         "p": block("transfer_function", numerator=[3.0], denominator=[1.0, 1.0])},
        ["r -> e.in1", "p -> e.in2", "e -> h", "h -> p"],
        {"y": "p"},
    )  # fmt: skip
    found = run(made, None)
    assert found.verdict is Verdict.OK
    assert found.metrics["y"]["steady_state_error"].value == pytest.approx(0.25, abs=1e-12)


def test_algebraic_loop_through_a_saturation():
    """y = sat(2 (r - y)): 2 r / 3 inside the limits."""
    made = diagram(
        {"e": block("sum", signs="+-"), "g": block("gain", gain=2.0), "s": block("saturation")},
        ["r -> e.in1", "s -> e.in2", "e -> g", "g -> s"],
        {"y": "s", "u": "r"},
    )
    found = run(made, 4.0, "sine", amplitude=4.0, frequency=2.0)
    np.testing.assert_allclose(found.curves["y"], np.clip(2 * found.curves["u"] / 3, -1, 1), atol=1e-10)


def test_an_ill_posed_loop_through_a_saturation_names_its_ports():
    with pytest.raises(IllPosedError, match=r"s\.out"):
        diagram(
            {"e": block("sum", signs="++"), "s": block("saturation")},
            ["r -> e.in1", "s -> e.in2", "e -> s"],
            {"y": "s"},
        )


def test_saturation_behind_a_delay():
    """x' = sat(3 - x(t - 1)): x = t up to 3, then x' = 4 - t up to t = 4."""
    made = diagram(
        {
            "e": block("sum", signs="+-"),
            "s": block("saturation"),
            "x": block("integrator"),
            "d": block("delay", time=1.0),
        },
        ["r -> e.in1", "d -> e.in2", "e -> s", "s -> x", "x -> d"],
        {"y": "x"},
    )
    found = run(made, 4.0, amplitude=3.0)
    t = found.time
    np.testing.assert_allclose(found.curves["y"], np.where(t < 3, t, 4 * t - t**2 / 2 - 4.5), atol=1e-11)


def test_events_that_accumulate_end_with_a_verdict():
    """x'' = -sign(x) - 0.5 sign(x') switches infinitely often before it comes to rest (twisting algorithm)."""
    made = diagram(
        {"a": block("relay"), "b": block("relay", low=-0.5, high=0.5, hysteresis=1e-12),
         "n": block("sum", signs="+--"), "v": block("integrator"), "x": block("integrator", initial=1.0)},
        ["r -> n.in1", "a -> n.in2", "b -> n.in3", "n -> v", "v -> x", "x -> a", "v -> b"],
        {"y": "x"},
    )  # fmt: skip
    found = run(made, 20.0, amplitude=0.0)
    assert found.verdict is Verdict.DOUBTFUL
    assert any("accumulate" in remark.detail or "chattering" in remark.detail for remark in found.warnings)


def test_events_that_follow_each_other_ever_faster_are_told_as_such():
    """y = 0.95 is an edge of the quantizer behind which it pushes back: the loop rests there by switching ever faster."""
    made = diagram(
        {"e": block("sum", signs="+-"), "g": block("gain", gain=4.0), "q": block("quantizer", step=0.1),
         "p": block("transfer_function", numerator=[1.0], denominator=[0.05, 1.0, 0.0])},
        ["r -> e.in1", "q -> e.in2", "e -> g", "g -> p", "p -> q"],
        {"y": "p"},
    )  # fmt: skip
    found = run(made, 5.0, amplitude=0.97)
    assert found.verdict is Verdict.DOUBTFUL
    assert any("events of q accumulate" in remark.detail for remark in found.warnings)


def test_a_response_that_grows_without_bound_is_unstable():
    made = diagram(
        {"p": block("multiplication", operations="**"), "n": block("sum", signs="++"), "x": block("integrator")},
        ["r -> n.in1", "p -> n.in2", "x -> p.in1", "x -> p.in2", "n -> x"],
        {"y": "x"},
    )
    found = run(made, 5.0)  # x' = 1 + x²: tan t, which ends at π/2
    assert found.verdict is Verdict.UNSTABLE
    early = found.time < 1.5
    np.testing.assert_allclose(found.curves["y"][early], np.tan(found.time[early]), rtol=1e-9)


def test_a_simulation_that_ends_too_early_says_so():
    made = diagram(
        {"s": block("saturation"), "p": block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0])},
        ["r -> s", "s -> p"], {"y": "p"},
    )  # fmt: skip
    found = run(made, 1.0)
    assert found.verdict is Verdict.OK
    assert found.metrics["y"]["rise_time"].verdict is Verdict.NOT_SETTLED
    assert found.metrics["y"]["peak"].value == pytest.approx(1 - np.exp(-1), abs=1e-11)

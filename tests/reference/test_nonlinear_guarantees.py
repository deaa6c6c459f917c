"""What must hold of every nonlinear simulation: energy, limits, the linear engine at small amplitude, and an end with a verdict."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.study import simulate
from engine.diagram.diagram import compile_system
from engine.elements import catalogue
from engine.exact.nonlinear import bounds
from engine.model.errors import EngineError
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

SPENCER = {
    "k0": [0.150133], "k1": 1238.7977, "x0": 0.0, "alpha": [15221.0961, 41508.4056, -38152.0043], "gamma": 1.89407553e6,
    "gamma_rate": -3.65610854, "c0": [924.911328, 7625.96402], "c1": [9867.12839, 78336.6934], "A": 300.0, "n": 2.0,
}  # fmt: skip
"""The published fit; physical for currents of 0 to 1 A."""


def swinging(seed: int, scale: float):
    """Return six sines with phases that keep their sum low."""
    return make("multisine", {"amplitude": scale, "fundamental": 2.0 + 0.37 * seed, "harmonics": [1, 2, 3, 5, 8, 13]})


PASSIVE = [
    # kind, values, power taken in as (sign, signal given, signal answered), scale of each signal given
    ("viscous_damper", {"damping": 300.0}, [(1, "velocity", "force")], {"velocity": 0.1}),
    ("friction", {"coulomb": 20.0, "viscous": 50.0}, [(1, "velocity", "force")], {"velocity": 0.1}),
    ("friction", {"coulomb": 20.0, "viscous": 5.0, "static": 35.0, "stribeck_velocity": 0.05, "coulomb_negative": 8.0},
     [(1, "velocity", "force")], {"velocity": 0.1}),
    ("mr_damper_bingham", {"yield_force": [60.0, 700.0], "damping": [800.0]}, [(1, "velocity", "force")],
     {"velocity": 0.1, "current": 0.0}),
    ("mr_damper_dahl", {"damping": [768.2], "friction": [57.42, 300.0], "rho": 2745.0}, [(1, "velocity", "force")],
     {"velocity": 0.1, "current": 0.0}),
    ("mass_spring_damper", {"mass": 2.0, "stiffness": 800.0, "damping": 4.0}, [(1, "force", "velocity")], {"force": 5.0}),
    ("two_inertia", {}, [(1, "motor_torque", "motor_speed"), (-1, "load_torque", "load_speed")],
     {"motor_torque": 1.0, "load_torque": 1.0}),
    ("compliant_arm", {}, [(1, "base_force", "base_velocity"), (1, "end_effector_force", "end_effector_velocity")],
     {"base_force": 1.0, "end_effector_force": 1.0}),
    ("dc_motor", {}, [(1, "voltage", "current"), (-1, "load_torque", "speed")], {"voltage": 10.0, "load_torque": 0.1}),
    ("linear_hydraulic_motor", {}, [(1, "flow", "pressure_difference"), (-1, "force", "velocity")],
     {"flow": 1e-5, "force": 100.0}),
    ("linear_pneumatic_motor", {}, [(1, "flow", "pressure_difference"), (-1, "force", "velocity")],
     {"flow": 1e-5, "force": 10.0}),
    ("rotary_hydraulic_motor", {}, [(1, "flow", "pressure_difference"), (-1, "load_torque", "speed")],
     {"flow": 1e-5, "load_torque": 1.0}),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "values", "power", "scales"), PASSIVE)
def test_from_rest_a_passive_element_never_gives_back_more_than_it_took(kind, values, power, scales):
    element = catalogue()[kind]
    given = dict(element.example) | values
    blocks = {name: block("input") for name in scales}
    made = compile_system(
        document(
            blocks | {"law": block(kind, **given)},
            [f"{name} -> law.{name}" for name in scales],
            {answer: f"law.{answer}" for _, _, answer in power},
        )
    )
    commands = {name: swinging(k, scale) for k, (name, scale) in enumerate(scales.items()) if scale}
    if "current" in scales:
        commands["current"] = make("step", {"amplitude": 0.7})
    found = simulate(made, signals=commands, duration=3.0, samples=30001)
    t = found.time
    flow = sum(sign * commands[own].value(t) * found.curves[answer] for sign, own, answer in power)
    taken = np.concatenate([[0.0], np.cumsum((flow[1:] + flow[:-1]) / 2 * np.diff(t))])
    assert taken.max() > 0
    assert taken.min() >= -1e-6 * taken.max()


@pytest.mark.parametrize("current", [0.0, 0.5, 1.0])
def test_from_rest_a_bouc_wen_damper_never_gives_back_more_than_it_took(current):
    made = compile_system(
        document(
            {"velocity": block("input"), "current": block("input"), "x": block("integrator"),
             "law": block("mr_damper_spencer", **SPENCER)},
            ["velocity -> x", "x -> law.displacement", "velocity -> law.velocity", "current -> law.current"],
            {"force": "law.force"},
        )
    )  # fmt: skip
    commands = {"velocity": swinging(3, 0.02), "current": make("step", {"amplitude": current})}
    found = simulate(made, signals=commands, duration=3.0, samples=30001)
    flow = commands["velocity"].value(found.time) * found.curves["force"]
    taken = np.concatenate([[0.0], np.cumsum((flow[1:] + flow[:-1]) / 2 * np.diff(found.time))])
    assert taken.max() > 0
    assert taken.min() >= -1e-6 * taken.max()


@pytest.mark.parametrize("seed", range(4))
def test_limits_are_never_exceeded(seed):
    """Not by rounding, and not between the samples: in a loop that is at its limits most of the time."""
    rng = np.random.default_rng(seed)
    low, high = -float(rng.uniform(0.1, 2.0)), float(rng.uniform(0.1, 2.0))
    made = compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"),
             "c": block("sampled_pid", kp=30.0, ki=40.0, kd=0.3, filter_frequency=80.0, sample_time=0.02, lower=2 * low,
                        upper=2 * high),
             "s": block("saturation", lower=low, upper=high), "l": block("rate_limiter", rising=9.0, falling=7.0),
             "t": block("lookup_table", points=[-0.5, 0.5], values=[-0.3, 0.3]),
             "p": block("transfer_function", numerator=[4.0], denominator=[0.05, 1.0, 0.0])},
            ["r -> e.in1", "p -> e.in2", "e -> c", "c -> s", "s -> l", "l -> t", "t -> p"],
            {"y": "p", "c": "c", "s": "s", "l": "l", "t": "t"},
        )
    )  # fmt: skip
    found = simulate(made, signals={"r": swinging(seed, 1.0)}, duration=2.0, samples=4001)
    bounds = {"c": (2 * low, 2 * high), "s": (low, high), "t": (-0.3, 0.3)}
    for name, (least, greatest) in bounds.items():
        assert found.curves[name].min() >= least, name
        assert found.curves[name].max() <= greatest, name
        assert found.metrics[name]["peak"].value <= max(-least, greatest), name
        assert found.curves[name].max() == greatest or found.curves[name].min() == least, name
    rate = np.diff(found.curves["l"]) / np.diff(found.time)
    assert rate.max() <= 9.0 * (1 + 1e-9)
    assert rate.min() >= -7.0 * (1 + 1e-9)


def straightened(nonlinear: bool):
    """Return a position loop of a mass with damping, a spring and a filter; the same made of nonlinear elements."""
    common = {
        "r": block("input"), "e": block("sum", signs="+-"), "v": block("integrator"), "x": block("integrator"),
        "c": block("pid", kp=60.0, ki=30.0, kd=6.0, filter_frequency=300.0),
    }  # fmt: skip
    if not nonlinear:
        blocks = common | {"n": block("sum", signs="+--"), "b": block("gain", gain=2.5), "k": block("gain", gain=3.0)}
        wires = ["r -> e.in1", "x -> e.in2", "e -> c", "c -> n.in1", "v -> b", "b -> n.in2", "x -> k", "k -> n.in3",
                 "n -> v", "v -> x"]  # fmt: skip
        return compile_system(document(blocks, wires, {"y": "x", "v": "v", "u": "c"}))
    blocks = common | {
        # all of them within the range in which they are what they stand for
        "n": block("sum", signs="+-----"), "one": block("passive_on", current=1.0), "product": block("multiplication"),
        "s": block("saturation", lower=-1e3, upper=1e3), "l": block("rate_limiter", rising=1e14),
        "table": block("lookup_table", points=[-9.0, 9.0], values=[-27.0, 27.0], extrapolation="linear"),
        "play": block("backlash", width=0.0), "d": block("dead_zone", lower=0.0, upper=0.0),
        "f": block("friction", coulomb=0.0, viscous=1.0), "vd": block("viscous_damper", damping=0.5),
        "bingham": block("mr_damper_bingham", yield_force=[0.0], damping=[0.25], transition_velocity=0.01),
        "dahl": block("mr_damper_dahl", damping=[0.75], friction=[0.0], rho=100.0),
    }  # fmt: skip
    wires = [
        "r -> e.in1", "x -> e.in2", "e -> c", "c -> s", "s -> l", "l -> product.in1", "one -> product.in2",
        "product -> n.in1", "v -> f.velocity", "f -> n.in2", "v -> vd.velocity", "vd -> n.in3",
        "v -> bingham.velocity", "bingham -> n.in4", "v -> dahl.velocity", "dahl -> n.in5",
        "x -> play", "play -> d", "d -> table", "table -> n.in6", "n -> v", "v -> x",
    ]  # fmt: skip
    return compile_system(document(blocks, wires, {"y": "x", "v": "v", "u": "c"}))


def test_at_small_amplitude_nonlinear_elements_are_the_linear_engine():
    step = {"r": make("step", {"amplitude": 0.01})}
    exact, found = (simulate(straightened(kind), signals=step, duration=6.0, samples=601) for kind in (False, True))
    for name, curve in exact.curves.items():
        np.testing.assert_allclose(found.curves[name], curve, atol=1e-8 * np.abs(curve).max(), err_msg=name)
    exact, found = (simulate(straightened(kind), signals=step) for kind in (False, True))
    assert found.verdict is Verdict.OK
    for name, metrics in exact.metrics.items():
        for metric, measured in metrics.items():
            other = found.metrics[name][metric]
            assert other.verdict == measured.verdict, (name, metric)
            if measured.value is not None:
                assert other.value == pytest.approx(measured.value, rel=1e-8, abs=1e-10), (name, metric)


def test_a_relay_that_contradicts_itself_ends_with_a_verdict():
    """u = r - y: from r = 0.5 on, u = -0.5 switches the relay off and 1.5 on again, for ever in one instant."""
    made = compile_system(
        document({"r": block("input"), "e": block("sum", signs="+-"), "k": block("relay", low=0.0, hysteresis=0.1)},
                 ["r -> e.in1", "k -> e.in2", "e -> k"], {"y": "k"})
    )  # fmt: skip
    found = simulate(made, signals={"r": make("step", {"amplitude": 0.5, "start": 0.3})}, duration=1.0)
    assert found.verdict is Verdict.DOUBTFUL
    assert any("chattering" in remark.detail for remark in found.warnings)


def test_chatter_that_only_slowly_becomes_faster_ends_with_a_verdict():
    """A mass on the edge between two levels of its encoder: ever faster, ever smaller swings, which no time step ends."""
    made = compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "c": block("pd", kp=400.0, kd=8.0, filter_frequency=2000.0),
             "m": block("mass_spring_damper", mass=1.0, stiffness=0.0, damping=2.0), "q": block("quantizer", step=0.005)},
            ["r -> e.in1", "m.position -> q", "q -> e.in2", "e -> c", "c -> m.force"],
            {"y": "m.position"},
        )
    )  # fmt: skip
    # Some 400 events a millisecond, which depends on rounding: over 2 s that is twice the pace that counts as an accumulation.
    found = simulate(made, signals={"r": make("step", {"amplitude": 0.1})}, duration=2.0)
    assert found.verdict is Verdict.DOUBTFUL
    assert any("accumulate" in remark.detail for remark in found.warnings)
    rest = found.curves["y"][np.isfinite(found.curves["y"])][-1]
    assert rest == pytest.approx(0.1025, abs=1e-6)  # 20.5 steps: an edge


def test_a_twisting_loop_ends_with_a_verdict():
    """x'' = -sign(x - 1) - sign(x')/2: each half swing is 1/√3 of the last, their sum is finite: infinitely many switches before that."""
    made = compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "k": block("relay"), "d": block("relay"),
             "g": block("gain", gain=0.5), "n": block("sum", signs="+-"), "v": block("integrator"), "x": block("integrator")},
            ["r -> e.in1", "x -> e.in2", "e -> k", "v -> d", "d -> g", "k -> n.in1", "g -> n.in2", "n -> v", "v -> x"],
            {"x": "x"},
        )
    )  # fmt: skip
    found = simulate(made, signals={"r": make("step", {})}, duration=20.0, samples=20_001)
    assert found.verdict is Verdict.DOUBTFUL
    # to x = 1 with x'' = 1 - 1/2 in 2 s; then down with 3/2 and back with 1/2, by 1/√3 faster each time
    first, ratio = 2.0, 1 / np.sqrt(3.0)
    swing = 1.0 / 1.5 + 1.0 / 1.5 * np.sqrt(3.0)  # with x' = 1: until it turns, and back to x = 1
    end = first + swing / (1 - ratio)
    known = found.time[np.isfinite(found.curves["x"])]
    assert known[-1] == pytest.approx(end, rel=1e-3)
    assert found.curves["x"][np.isfinite(found.curves["x"])][-1] == pytest.approx(1.0, abs=1e-3)


def test_a_relay_with_almost_no_hysteresis_ends_with_a_verdict():
    """Half a million switches a second: x' = 100 (±1 - x) between 0.5 ± 1e-6 takes 4e-8 s."""
    made = compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "k": block("relay", hysteresis=1e-6),
             "p": block("transfer_function", numerator=[1.0], denominator=[0.01, 1.0])},
            ["r -> e.in1", "p -> e.in2", "e -> k", "k -> p"],
            {"x": "p"},
        )
    )  # fmt: skip
    found = simulate(made, signals={"r": make("step", {"amplitude": 0.5})}, duration=2.0)
    assert found.verdict is Verdict.DOUBTFUL
    assert any("accumulate" in remark.detail for remark in found.warnings)


def test_a_table_that_contradicts_itself_ends_with_a_verdict():
    """u = r - y through a table that falls steeply: every piece gives an input that lies on the other one."""
    made = compile_system(
        document({"r": block("input"), "e": block("sum", signs="+-"),
                  "k": block("lookup_table", points=[-1.0, 0.0, 1.0], values=[1.0, -3.0, 2.0])},
                 ["r -> e.in1", "k -> e.in2", "e -> k"], {"y": "k"})
    )  # fmt: skip
    found = simulate(made, signals={"r": make("step", {"amplitude": 0.3})}, duration=1.0)
    assert found.verdict is Verdict.DOUBTFUL
    assert any("chattering" in remark.detail for remark in found.warnings)


def test_a_loop_through_a_relay_alone_is_refused():
    """Sliding at u = 0 would take an output of 0 to be given by the relay to itself."""
    with pytest.raises(EngineError, match="what k hold must be moved by their outputs"):
        compile_system(
            document({"r": block("input"), "e": block("sum", signs="+-"), "k": block("relay")},
                     ["r -> e.in1", "k -> e.in2", "e -> k"], {"y": "k"})
        )  # fmt: skip


@pytest.mark.parametrize("rate", [1e6, 1e10, 1e14])
def test_a_jump_through_a_very_fast_limiter(rate):
    """y' = u, u from 0 to 1 within 1/rate: y = t - 1/(2 rate)."""
    made = compile_system(
        document({"r": block("input"), "l": block("rate_limiter", rising=rate), "x": block("integrator")},
                 ["r -> l", "l -> x"], {"y": "x", "u": "l"})
    )  # fmt: skip
    found = simulate(made, signals={"r": make("step", {})}, duration=1.0, samples=11)
    np.testing.assert_allclose(found.curves["y"][1:], found.time[1:] - 0.5 / rate, rtol=1e-12)
    np.testing.assert_allclose(found.curves["u"][1:], 1.0, rtol=1e-14)


@pytest.mark.parametrize("restitution", [0.0, 0.6, 0.95])
def test_a_bouncing_piston_comes_to_rest(restitution):
    """Bounces are ever shorter, their sum is finite: e^n v below the slowest bounce ends them, and the piston rests exactly."""
    made = compile_system(
        document(
            {"r": block("input"), "c": block("pneumatic_cylinder", restitution=restitution, initial_position=0.02)},
            ["r -> c.command"], {"x": "c.position", "v": "c.velocity"},
        )
    )  # fmt: skip
    found = simulate(made, signals={"r": make("step", {"amplitude": -1.0})}, duration=1.5, samples=3001)
    assert found.verdict is Verdict.OK
    assert found.curves["x"].min() >= 0.0
    assert np.all(found.curves["v"][-100:] == 0.0)
    assert (found.curves["v"].max() > 1e-3) == (restitution > 0)


def test_steps_are_limited_with_a_verdict(monkeypatch):
    monkeypatch.setattr(bounds, "MAX_STEPS", 200)
    made = compile_system(
        document({"r": block("input"), "q": block("quantizer", step=0.01)}, ["r -> q"], {"y": "q"}),
    )
    found = simulate(
        made, signals={"r": make("sine", {"amplitude": 1.0, "frequency": 7.0})}, duration=10.0, samples=2001
    )
    assert found.verdict is Verdict.TOO_SHORT
    assert any("after 200 steps" in remark.detail for remark in found.warnings)
    known = np.isfinite(found.curves["y"])
    assert 0 < known.sum() < 2001
    t = found.time[known][:-1]
    np.testing.assert_allclose(found.curves["y"][: len(t)], np.sin(7 * t), atol=0.0051)

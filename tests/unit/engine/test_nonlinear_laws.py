"""Semi-active laws, operating points, limits of the computation, and nonlinear blocks wherever blocks may be."""

from __future__ import annotations

import itertools
import pickle

import numpy as np
import pytest

from engine.analysis.influence import influence
from engine.analysis.measuring import MetricRequest
from engine.analysis.study import frequency_response, simulate
from engine.diagram.diagram import compile_system
from engine.exact.nonlinear.integrate import Integration
from engine.exact.nonlinear.operating_point import operating_point
from engine.exact.nonlinear.response import respond
from engine.model.verdicts import Verdict
from engine.signals import make
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from tests.unit.engine.diagrams import block, document, subsystem

STEP = make("step", {})


def law(kind: str, *inputs: str, **values: float):
    return compile_system(
        document(
            {**{name: block("input") for name in inputs}, "k": block(kind, **values)},
            [f"{name} -> k.{name}" for name in inputs],
            {"i": "k"},
        )
    )


@pytest.mark.parametrize(
    ("kind", "first", "second", "product"),
    [
        ("skyhook", "velocity", "relative_velocity", lambda a, b: a * b),
        ("groundhook", "base_velocity", "relative_velocity", lambda a, b: -a * b),
        ("clipped_optimal", "wanted_force", "force", lambda a, b: (a - b) * b),
    ],
)
def test_a_switched_current_follows_the_sign_of_its_product(kind, first, second, product):
    made = law(kind, first, second, off=0.2, on=1.5)
    given = {
        first: make("sine", {"amplitude": 1.0, "frequency": 2.0, "phase": 0.3}),
        second: make("sine", {"amplitude": 0.7, "frequency": 3.0, "phase": 1.0}),
    }
    found = simulate(made, signals=given, duration=5.0, samples=2001)
    t = found.time
    s = product(np.sin(2 * t + 0.3), 0.7 * np.sin(3 * t + 1.0))
    clear = np.abs(s) > 1e-6
    np.testing.assert_allclose(found.curves["i"][clear], np.where(s > 0, 1.5, 0.2)[clear], atol=1e-12)


def test_passive_laws_are_constant():
    for kind, value in (("passive_off", 0.0), ("passive_on", 1.0)):
        made = compile_system(
            document({"r": block("input"), "k": block(kind), "s": block("sum", signs="++")},
                     ["r -> s.in1", "k -> s.in2"], {"i": "k", "s": "s"})
        )  # fmt: skip
        found = simulate(made, signals={"r": STEP}, duration=1.0)
        np.testing.assert_allclose(found.curves["i"], value, atol=1e-14)
        np.testing.assert_allclose(found.curves["s"], 1 + value)


def test_a_clipped_force_slides_along_the_force_wanted():
    """f' = (4 i - f)/0.1 with i in {0, 1}: f = 4 (1 - e^-10t) up to 2, then exactly 2 with the mean current 0.5."""
    made = compile_system(
        document(
            {"r": block("input"), "k": block("clipped_optimal"),
             "f": block("transfer_function", numerator=[4.0], denominator=[0.1, 1.0])},
            ["r -> k.wanted_force", "f -> k.force", "k -> f"],
            {"f": "f", "i": "k"},
        )
    )  # fmt: skip
    # a start at f = 0, where the law sees no force to increase, needs a first push
    found = simulate(made, signals={"r": STEP}, duration=1.0)
    assert np.all(found.curves["f"] == 0.0)
    pushed = compile_system(
        document(
            {"r": block("input"), "k": block("clipped_optimal"), "g": block("gain", gain=40.0),
             "f": block("integrator", initial=0.1), "n": block("sum", signs="+-"), "b": block("gain", gain=10.0)},
            ["r -> k.wanted_force", "f -> k.force", "k -> g", "g -> n.in1", "f -> b", "b -> n.in2", "n -> f"],
            {"f": "f", "i": "k"},
        )
    )  # fmt: skip
    found = simulate(pushed, signals={"r": make("step", {"amplitude": 2.0})}, duration=1.0)
    t, reached = found.time, np.log(3.9 / 2) / 10
    np.testing.assert_allclose(found.curves["f"], np.where(t < reached, 4 - 3.9 * np.exp(-10 * t), 2.0), atol=1e-10)
    np.testing.assert_allclose(found.curves["i"][t > reached], 0.5, atol=1e-9)


def hanging():
    """Return a load on a hardening spring: x' = v, v' = r - v - x³ + 1; at rest x = 1 for r = 0, 2 for r = 7."""
    return compile_system(
        document(
            {"r": block("input"), "one": block("passive_on"), "cube": block("multiplication", operations="***"),
             "n": block("sum", signs="++--"), "v": block("integrator"), "x": block("integrator", initial=0.5)},
            ["r -> n.in1", "one -> n.in2", "v -> n.in3", "cube -> n.in4", "n -> v", "v -> x",
             "x -> cube.in1", "x -> cube.in2", "x -> cube.in3"],
            {"x": "x"},
        )
    )  # fmt: skip


def test_operating_point_and_linearisation():
    """About x = 1: x/r = 1/(s² + s + 3)."""
    made = hanging()
    point = operating_point(made.laws())
    assert point.rests
    assert point.y[0, 0] == pytest.approx(1.0, abs=1e-12)
    assert operating_point(made.laws(), {"r": 7.0}).y[0, 0] == pytest.approx(2.0, abs=1e-12)
    found = frequency_response(made, source="r", target="x", frequencies=np.array([0.5, 2.0]))
    s = 1j * np.array([0.5, 2.0])
    np.testing.assert_allclose(found.response, 1 / (s**2 + s + 3), rtol=1e-10)


def test_elasticity_of_a_margin_moves_with_the_operating_point():
    """The critical frequency is sqrt(3 x²), x³ = i: elasticity 1/3 in the current that pulls."""
    requests = {"w": MetricRequest(metric="critical_frequency")}
    found = influence(hanging(), requests, ["one.current"])
    assert found.base["w"].value == pytest.approx(np.sqrt(3), rel=1e-10)
    assert found.elasticities["w"]["one.current"].value == pytest.approx(1 / 3, rel=1e-8)


def limited(inside: bool = False):
    core = {"s": block("saturation", upper="=limit", lower="=-limit"), "x": block("integrator")}
    if not inside:
        return compile_system(
            document({"r": block("input"), "e": block("sum", signs="+-"), **core},
                     ["r -> e.in1", "x -> e.in2", "e -> s", "s -> x"], {"y": "x", "u": "s"}, limit=1.0)
        )  # fmt: skip
    drive = document({"u": block("input"), **core}, ["u -> s", "s -> x"], {"y": "x", "u": "s"}, limit=1.0)
    return compile_system(
        document({"r": block("input"), "e": block("sum", signs="+-"), "drive": subsystem(drive)},
                 ["r -> e.in1", "drive.y -> e.in2", "e -> drive.u"], {"y": "drive.y"})
    )  # fmt: skip


def test_a_law_inside_a_subsystem_and_a_pickled_diagram():
    signals = {"r": make("step", {"amplitude": 3.0})}
    plain = simulate(limited(), signals=signals, duration=5.0)
    for made in (limited(inside=True), pickle.loads(pickle.dumps(limited()))):
        np.testing.assert_allclose(
            simulate(made, signals=signals, duration=5.0).curves["y"], plain.curves["y"], atol=1e-13
        )


def test_a_loop_opened_at_a_law_is_linearised():
    """L = 1/s: phase margin 90°."""
    found = frequency_response(limited(), open_at="s", frequencies=np.array([2.0]))
    assert found.response[0] == pytest.approx(-0.5j, abs=1e-12)
    assert found.metrics["phase_margin"].value == pytest.approx(np.pi / 2, rel=1e-9)


def test_an_optimum_of_a_nonlinear_system():
    """t_s = (3 - u)/u + ln(u/0.06): smallest where 3/u² = 1/u, u = 3; the limit of the control makes it 2."""
    problem = Problem(
        diagram=limited(), variables=(Variable(parameter="limit", lower=0.5, upper=2.9),),
        experiments=(Experiment(name="step", signals={"r": make("step", {"amplitude": 3.0})}),),
        goals=(
            Goal(metric="settling_time", experiment="step", output="y", sense=Sense.MINIMIZE),
            Goal(metric="control_effort", experiment="step", output="u", upper=2.0),
        ),
    )  # fmt: skip
    found = minimize("gradient", problem, {"starts": 1, "seed": 1, "max_evaluations": 40})
    assert found.best["limit"] == pytest.approx(2.0, abs=1e-5)


def test_computing_time_is_limited_with_a_verdict():
    ticks = itertools.count()
    made = limited()
    found = respond(
        made.laws(), {"r": make("sine", {"amplitude": 3.0, "frequency": 5.0})}, 100.0, 1.0,
        clock=lambda: float(next(ticks)), limit=20.0,
    )  # fmt: skip
    assert found.outcome.verdict is Verdict.TOO_SHORT
    assert 0 < found.outcome.end < 100
    assert "20 s of computing" in found.outcome.advice


def test_the_error_estimate_is_kept():
    """x' = sat(2 sin 3t - x) at a tolerance of 1e-6 differs from one at 1e-13 by no more than it says."""
    made = limited()
    signals = {"r": make("sine", {"amplitude": 2.0, "frequency": 3.0})}
    t = np.linspace(0, 6, 301)
    coarse, fine = (Integration(made.laws(), signals, tolerance=tol).advance(6.0) for tol in (1e-6, 1e-13))
    difference = np.abs(coarse.output(0).sample(t) - fine.output(0).sample(t)).max()
    assert difference <= max(10 * coarse.error, 1e-12)
    assert coarse.error <= 1e-6

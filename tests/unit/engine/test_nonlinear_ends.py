"""Where a nonlinear response ends: at rest, still, running on for ever, or only on its way."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.evaluation import Evaluation
from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import simulate
from engine.diagram.diagram import compile_system
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document


def limited_drive(**controller: object):
    """Return x' = sat(u) with limits of ±1."""
    return compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "c": block(**controller), "s": block("saturation"),
             "x": block("integrator")},
            ["r -> e.in1", "x -> e.in2", "e -> c", "c -> s", "s -> x"],
            {"x": "x", "u": "s"},
        )
    )  # fmt: skip


def ends(made, duration, amplitude=1000.0):
    response = Evaluation(made).simulated({"r": make("step", {"amplitude": amplitude})}, duration)
    return dict(response.verdicts)


def test_a_drive_at_its_limit_is_followed_until_it_arrives():
    """x' = sat(10 (1000 - x)): x = t until 999.9, a thousand lifetimes of the linear loop; then 1000 - 0.1 e^(-10 (t - 999.9))."""
    made = limited_drive(kind="p", kp=10.0)
    found = simulate(made, signals={"r": make("step", {"amplitude": 1000.0})})
    assert found.verdict is Verdict.OK
    assert found.metrics["x"]["rise_time"].value == pytest.approx(800.0, rel=1e-9)
    assert found.metrics["x"]["settling_time"].value == pytest.approx(980.0, rel=1e-9)
    assert found.metrics["x"]["overshoot"].value == pytest.approx(0.0, abs=1e-9)


def test_what_is_on_its_way_has_not_settled_and_is_no_integrator():
    """Position and velocity alike: the constant velocity is not where it ends."""
    made = limited_drive(kind="p", kp=10.0)
    assert ends(made, 500.0) == {"x": Verdict.NOT_SETTLED, "u": Verdict.NOT_SETTLED}
    assert ends(made, 1200.0) == {"x": Verdict.OK, "u": Verdict.OK}


def test_a_sampled_drive_at_its_limit_is_no_integrator():
    made = limited_drive(kind="sampled_pid", kp=4.0, sample_time=0.1)
    assert ends(made, 5.0, amplitude=20.0) == {"x": Verdict.NOT_SETTLED, "u": Verdict.NOT_SETTLED}
    assert ends(made, 25.0, amplitude=20.0) == {"x": Verdict.OK, "u": Verdict.OK}


@pytest.mark.parametrize("duration", [None, 5.0])
def test_what_nothing_looks_at_runs_on_for_ever(duration):
    """x' = sat(2) = 1, with a filter on it: the rate is final, the position is not."""
    made = compile_system(
        document(
            {
                "r": block("input"),
                "s": block("saturation"),
                "x": block("integrator"),
                "f": block("low_pass", frequency=20.0),
            },
            ["r -> s", "s -> x", "x -> f"],
            {"x": "x", "u": "s", "filtered": "f"},
        )
    )
    found = ends(made, duration, amplitude=2.0)
    assert found == {"x": Verdict.INTEGRATING, "u": Verdict.OK, "filtered": Verdict.INTEGRATING}


def test_an_integrator_that_winds_up_behind_a_limit_leaves_what_is_seen_at_its_end():
    """A reference out of reach: u = 1 and y = 1 are final while the controller integrates for ever."""
    made = compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "c": block("pi", kp=1.0, ki=2.0), "s": block("saturation"),
             "p": block("transfer_function", numerator=[1.0], denominator=[0.1, 1.0])},
            ["r -> e.in1", "p -> e.in2", "e -> c", "c -> s", "s -> p"],
            {"y": "p", "u": "s", "wound": "c"},
        )
    )  # fmt: skip
    assert ends(made, 5.0, 3.0) == {"y": Verdict.OK, "u": Verdict.OK, "wound": Verdict.INTEGRATING}


def test_a_controller_that_winds_up_until_the_drive_breaks_away_is_not_at_rest():
    """A mass that sticks under 1 N while u = 0.2 (1 + 0.1 t) grows: still, until t = 40 s."""
    made = compile_system(
        document(
            {"r": block("input"), "c": block("pi", kp=0.2, ki=0.02), "f": block("friction", coulomb=1.0),
             "n": block("sum", signs="+-"), "v": block("integrator"), "x": block("integrator")},
            ["r -> c", "c -> n.in1", "v -> f.velocity", "f -> n.in2", "n -> v", "v -> x"],
            {"x": "x"},
        )
    )  # fmt: skip
    assert ends(made, 20.0, 1.0) == {"x": Verdict.NOT_SETTLED}
    response = Evaluation(made).simulated({"r": make("step", {})}, 60.0)
    position = response.output("x").sample(np.array([39.9, 50.0]))
    assert position[0] == 0.0
    assert position[1] == pytest.approx(0.02 * 10.0**3 / 6, rel=1e-9)  # x'' = 0.02 (t - 40)


def test_what_moves_by_less_than_a_millionth_has_stopped():
    """y = 1 - e^-t beside a position that runs on, so that there is no state of rest: by t = 18 it moves by 8e-8."""
    made = compile_system(
        document(
            {"r": block("input"), "s": block("saturation", lower=-2.0, upper=2.0), "x": block("integrator"),
             "y": block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0])},
            ["r -> s", "s -> x", "s -> y"],
            {"x": "x", "y": "y"},
        )
    )  # fmt: skip
    found = simulate(made, signals={"r": make("step", {})}, duration=18.0)
    assert found.metrics["y"]["settling_time"].value == pytest.approx(np.log(50.0), rel=1e-6)
    assert found.metrics["x"]["settling_time"].verdict is Verdict.INTEGRATING


def test_a_state_that_rests_as_a_difference_is_at_rest_at_every_gain():
    """The filter of a lead rests at 0 to the rounding of what cancels there: whether it was called rest once hung on the gain's last digits."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "c": block("transfer_function", numerator=["=0.1*k", "=k"], denominator=[0.01, 1.0]),
        "law": block("mr_damper_bingham", yield_force=[0.25], damping=[0.5], transition_velocity=0.3),
        "x": block("transfer_function", numerator=[2.1875], denominator=[1.0, 3.5, 0.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "x -> e.in2", "e -> c", "c -> law", "law -> x"]
    diagram = compile_system(document(blocks, wires, {"y": "x"}, k=3.3))
    asked = [
        MetricRequest(metric="rise_time", signals={"r": make("step", {"amplitude": 1.625})}, output="y", duration=4.0)
    ]
    found = [measure(diagram, asked, overrides={"k": k})[0][0] for k in np.linspace(3.3, 4.3, 21)]
    assert {one.verdict for one in found} == {Verdict.OK}
    bends = np.diff([one.value for one in found], 3)
    assert np.abs(bends).max() < 1e-4


@pytest.mark.parametrize("gain", [2.0, 6.0, 10.0])
def test_play_that_may_rest_anywhere_is_followed_until_it_does(gain):
    """Where it will rest is not where it would rest now: a run of free length ends as one that is far longer."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "c": block("transfer_function", numerator=["=0.1*k", "=k"], denominator=[0.01, 1.0]),
        "play": block("backlash", width=0.1), "x": block("transfer_function", numerator=[3.0], denominator=[1.0, 2.0, 0.75]),
    }  # fmt: skip
    diagram = compile_system(
        document(blocks, ["r -> e.in1", "x -> e.in2", "e -> c", "c -> play", "play -> x"], {"y": "x"}, k=gain)
    )
    metrics = ("settling_time", "overshoot", "rise_time")
    asked = [
        MetricRequest(metric=metric, signals={"r": make("step", {"amplitude": 2.0})}, output="y", duration=duration)
        for duration in (None, 300.0) for metric in metrics
    ]  # fmt: skip
    found = [measured.value for measured, _ in measure(diagram, asked)]
    assert found[:3] == pytest.approx(found[3:], rel=2e-6)


def test_an_integral_of_all_time_has_its_tail():
    """A dead zone between a PID and a mass: it was taken for settled within a thousandth, and itae lacked a hundredth."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "c": block("pid", kp=3.4, ki=1.0, kd=0.34, filter_frequency=40.0),
        "zone": block("dead_zone", lower=-0.02, upper=0.01), "m": block("transfer_function", numerator=[1.0], denominator=[0.8, 1.0]),
        "x": block("integrator"),
    }  # fmt: skip
    wires = ["r -> e.in1", "x -> e.in2", "e -> c", "c -> zone", "zone -> m", "m -> x"]
    diagram = compile_system(document(blocks, wires, {"y": "x"}))
    asked = [
        MetricRequest(metric=metric, signals={"r": make("step", {"amplitude": 2.3})}, output="y", duration=duration)
        for duration in (None, 400.0) for metric in ("iae", "itae", "ise")
    ]  # fmt: skip
    found = [measured.value for measured, _ in measure(diagram, asked)]
    assert found[:3] == pytest.approx(found[3:], rel=2e-5)

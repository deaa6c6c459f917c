"""Limit cycles of simulated loops against describing functions and exact solutions, and the operating points about which loops are linearised."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from engine.analysis.limit_cycles import predicted
from engine.analysis.study import frequency_response, simulate
from engine.diagram.diagram import compile_system
from engine.model.errors import DiagramError
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document


def loop(law, plant):
    """Return r -> sum -> law -> plant -> sum."""
    return compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "law": law, "g": plant},
            ["r -> e.in1", "e -> law", "law -> g", "g -> e.in2"],
            {"y": "g", "u": "law"},
        )
    )


def lags(gain):
    """Return K/(s (s+1) (s+2))."""
    return block("transfer_function", numerator=[gain], denominator=[1.0, 3.0, 2.0, 0.0])


def test_a_saturated_loop_of_too_much_gain():
    """Phase -180° at sqrt 2, N(A) = 6/K = 0.6; the plant filters the third harmonic to a few percent."""
    made = loop(block("saturation"), lags(10.0))
    found = simulate(made, signals={"r": make("step", {"amplitude": 0.1})}, outputs=["y"], duration=120.0)
    cycle = found.limit_cycle
    assert cycle is not None
    (prediction,) = cycle.predictions
    assert prediction.block == "law"
    assert prediction.stable
    assert prediction.frequency == pytest.approx(math.sqrt(2), rel=1e-8)
    r = 1 / prediction.amplitude
    assert 2 / math.pi * (math.asin(r) + r * math.sqrt(1 - r * r)) == pytest.approx(0.6, rel=1e-8)
    # what comes back to the law is what it is given: y = -e for the fundamental
    assert prediction.outputs["y"] == pytest.approx(prediction.amplitude, rel=1e-8)
    assert prediction.outputs["u"] == pytest.approx(0.6 * prediction.amplitude, rel=1e-8)
    assert cycle.frequency == pytest.approx(prediction.frequency, rel=0.02)
    assert cycle.outputs["y"] == pytest.approx(prediction.outputs["y"], rel=0.03)
    assert any("limit cycle" in remark.detail for remark in found.warnings)


def test_a_relay_and_an_integrator_with_a_delay_exactly():
    """y' = -M sign y late by τ: a triangle of the period 4 τ between ±M τ; its fundamental has the amplitude 8 M τ/π².

    The describing function has 4 M/(π A) 1/w = 1 at w τ = π/2: the period is exact, A = 8 M τ/π² as well, since the
    fundamental of a triangle is just that.
    """
    made = compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "law": block("relay", low=-2.0, high=2.0),
             "x": block("integrator"), "d": block("delay", time=0.25)},
            ["r -> e.in1", "e -> law", "law -> x", "x -> d", "d -> e.in2"],
            {"y": "x"},
        )
    )  # fmt: skip
    found = simulate(made, signals={"r": make("step", {"amplitude": 0.05})}, duration=12.0)
    cycle = found.limit_cycle
    assert cycle is not None
    assert cycle.frequency == pytest.approx(2 * math.pi, rel=1e-9)
    assert cycle.outputs["y"] == pytest.approx(8 * 2 * 0.25 / math.pi**2, rel=1e-9)
    slowest = cycle.predictions[0]
    assert slowest.frequency == pytest.approx(2 * math.pi, rel=1e-8)
    assert slowest.amplitude == pytest.approx(8 * 2 * 0.25 / math.pi**2, rel=1e-8)
    assert slowest.stable


@pytest.mark.parametrize(
    ("law", "plant", "accuracy"),
    [
        (block("relay", low=-1.0, high=1.0, hysteresis=0.2), lags(1.0), 0.04),
        # an integrating controller over a gear with play: the textbook case of a hunting drive
        (block("backlash", width=0.2), lags(4.0), 0.10),
        (block("quantizer", step=0.1), lags(5.0), 0.08),
    ],
)
def test_the_stable_prediction_is_what_the_simulation_shows(law, plant, accuracy):
    found = simulate(loop(law, plant), signals={"r": make("step", {"amplitude": 0.4})}, outputs=["y"], duration=150.0)
    cycle = found.limit_cycle
    assert cycle is not None
    stable = [one for one in cycle.predictions if one.stable]
    nearest = min(stable, key=lambda one: abs(one.outputs["y"] - cycle.outputs["y"]))
    assert nearest.frequency == pytest.approx(cycle.frequency, rel=accuracy)
    assert nearest.outputs["y"] == pytest.approx(cycle.outputs["y"], rel=accuracy)


def test_coulomb_friction_that_feeds_a_swing_is_told_unstable():
    """v' = 0.2 v - x - F sign v: N = 4 F/(π A) = 0.2 at w = 1; smaller swings die, larger ones grow."""
    made = compile_system(
        document(
            {"r": block("input"), "n": block("sum", signs="++--"), "g": block("gain", gain=0.2), "v": block("integrator"),
             "x": block("integrator", initial=0.5), "f": block("friction", coulomb=0.1)},
            ["r -> n.in1", "v -> g", "g -> n.in2", "x -> n.in3", "f -> n.in4", "n -> v", "v -> x", "v -> f.velocity"],
            {"x": "x"},
        )
    )  # fmt: skip
    (cycle,) = predicted(made)
    assert not cycle.stable
    assert cycle.frequency == pytest.approx(1.0, rel=1e-8)
    assert cycle.amplitude == pytest.approx(4 * 0.1 / (math.pi * 0.2), rel=1e-8)
    # from a position inside it the mass comes to rest and sticks, from outside it grows for ever
    inside = simulate(made, signals={}, duration=30.0)
    assert abs(inside.curves["x"][-1]) < 0.5
    assert np.ptp(inside.curves["x"][-50:]) < 1e-15
    outside = simulate(made, signals={}, overrides={"x.initial": 0.8}, duration=30.0)
    assert np.abs(outside.curves["x"]).max() > 2.0


def test_friction_without_a_closed_form_is_integrated():
    """As above, with a friction that builds up over v_t: 4 F/(π A) falls short by no more than (v_t/A)² of itself, about."""
    blocks = {
        "n": block("sum", signs="+--"), "g": block("gain", gain=0.2), "v": block("integrator"), "x": block("integrator"),
        "f": block("friction", coulomb=0.1, transition_velocity=2e-3),
    }  # fmt: skip
    wires = ["v -> g", "g -> n.in1", "x -> n.in2", "f -> n.in3", "n -> v", "v -> x", "v -> f.velocity"]
    cycles = predicted(compile_system(document(blocks, wires, {"x": "x"})))
    large = max(cycles, key=lambda cycle: cycle.amplitude)
    assert not large.stable
    assert large.frequency == pytest.approx(1.0, rel=1e-6)
    assert large.amplitude == pytest.approx(4 * 0.1 / (math.pi * 0.2), rel=1e-3)


def test_a_loop_that_settles_has_no_limit_cycle():
    found = simulate(loop(block("saturation"), lags(2.0)), signals={"r": make("step", {"amplitude": 3.0})})
    assert found.limit_cycle is None
    assert found.verdict is Verdict.OK


def test_a_swing_that_dies_slowly_is_no_limit_cycle():
    """Damping ratio 0.001: a hundred periods are not enough to settle, and yet the amplitude falls."""
    made = compile_system(
        document({"r": block("input"), "s": block("saturation", lower=-5.0, upper=5.0),
                  "m": block("mass_spring_damper", mass=1.0, stiffness=1.0, damping=0.002)},
                 ["r -> s", "s -> m.force"], {"x": "m.position"})
    )  # fmt: skip
    found = simulate(made, signals={"r": make("step", {})}, duration=600.0)
    assert found.limit_cycle is None
    assert found.verdict is Verdict.OK


def spring():
    """Return x'' + x' + x³ = r: at rest x = r^(1/3), with a slope of 3 x²."""
    return compile_system(
        document(
            {"r": block("input"), "cube": block("multiplication", operations="***"), "n": block("sum", signs="+--"),
             "v": block("integrator"), "x": block("integrator", initial=0.1)},
            ["r -> n.in1", "v -> n.in2", "cube -> n.in3", "n -> v", "v -> x",
             "x -> cube.in1", "x -> cube.in2", "x -> cube.in3"],
            {"x": "x"},
        )
    )  # fmt: skip


@pytest.mark.parametrize("force", [8.0, -27.0])
def test_a_system_is_linearised_where_constant_inputs_hold_it(force):
    made = spring().about({"r": force})
    x = math.copysign(abs(force) ** (1 / 3), force)
    w = np.array([0.3, 2.0, 20.0])
    found = frequency_response(made, source="r", target="x", frequencies=w)
    s = 1j * w
    np.testing.assert_allclose(found.response, 1 / (s**2 + s + 3 * x * x), rtol=1e-10)
    assert found.operating_point.rests
    assert found.operating_point.inputs == {"r": force}
    assert found.operating_point.outputs["x"] == pytest.approx(x, rel=1e-12)
    assert any(f"inputs r = {force:g}" in remark.detail for remark in found.warnings)
    again = frequency_response(pickle.loads(pickle.dumps(made)), source="r", target="x", frequencies=w)
    np.testing.assert_array_equal(again.response, found.response)


def test_where_nothing_rests_the_answer_says_so():
    """A force on a free mass: it goes on for ever."""
    made = compile_system(
        document({"r": block("input"), "s": block("saturation"), "m": block("mass_spring_damper", mass=1.0, stiffness=0.0, damping=0.0)},
                 ["r -> s", "s -> m.force"], {"x": "m.position"})
    )  # fmt: skip
    found = frequency_response(made.about({"r": 0.5}), source="r", target="x", frequencies=np.array([2.0]))
    assert not found.operating_point.rests
    assert any("no state of rest" in remark.detail for remark in found.warnings)
    with pytest.raises(DiagramError, match="input must be one of r, got 'ghost'"):
        made.about({"ghost": 1.0})

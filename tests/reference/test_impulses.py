"""Responses to impulses beside closed forms: 2/(s² + 0.8 s + 4), whose answer to δ is 2 e^(-0.4 t) sin(w t)/w, w² = 3.84."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.commanded import CommandParameter
from engine.analysis.influence import influence
from engine.analysis.measuring import MetricRequest
from engine.analysis.study import simulate
from engine.diagram.diagram import Diagram, compile_system
from engine.model.errors import EngineError
from engine.recordings.spectra.simulated import transient
from engine.signals import make
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from optimizers.solving.solve import solve
from tests.unit.engine.diagrams import block, document

W = np.sqrt(3.84)
BLOW = make("impulse", {"area": 1.5})


def answer(t: np.ndarray) -> np.ndarray:
    return np.where(t >= 0, 3.0 * np.exp(-0.4 * t) * np.sin(W * t) / W, 0.0)


def plant(*, behind: str | None = None, **values: float) -> Diagram:
    """Return the plant, and what comes behind it."""
    blocks = {
        "u": block("input"),
        "plant": block("transfer_function", numerator=["=gain"], denominator=[1.0, 0.8, 4.0]),
    }
    wires = ["u -> plant"]
    if behind:
        blocks["last"] = block(behind, **values)
        wires.append("plant -> last")
    return compile_system(document(blocks, wires, {"y": "last" if behind else "plant"}, gain=2.0))


@pytest.mark.parametrize(
    ("behind", "values", "late", "scale"),
    [
        (None, {}, 0.0, 1.0),
        ("delay", {"time": 0.3}, 0.3, 1.0),
        ("saturation", {"lower": -10.0, "upper": 10.0}, 0.0, 1.0),
        ("gain", {"gain": -2.0}, 0.0, -2.0),
    ],
)
@pytest.mark.parametrize("duration", [None, 6.0])
def test_the_response_is_that_of_the_states_it_leaves(behind, values, late, scale, duration):
    found = simulate(plant(behind=behind, **values), signals={"u": BLOW}, duration=duration)
    np.testing.assert_allclose(found.curves["y"], scale * answer(found.time - late), rtol=0, atol=2e-10)


def test_a_limited_blow_is_cut_off():
    found = simulate(plant(behind="saturation", lower=-0.5, upper=0.8), signals={"u": BLOW}, duration=6.0)
    np.testing.assert_allclose(found.curves["y"], np.clip(answer(found.time), -0.5, 0.8), rtol=0, atol=2e-10)


def test_metrics_and_their_derivatives():
    """The peak is proportional to area and gain; at tan(w t) = w/0.4, t = 0.6988..."""
    diagram = plant()
    time = np.arctan2(W, 0.4) / W
    peak = MetricRequest(metric="peak", signals={"u": BLOW}, output="y")
    area = MetricRequest(metric="iae", signals={"u": BLOW}, output="y")
    commands = {"signals.u.area": CommandParameter(signal=BLOW, path="area")}
    found = influence(diagram, {"peak": peak, "iae": area}, ["gain"])
    assert found.base["peak"].value == pytest.approx(float(answer(np.array([time]))[0]), rel=1e-10)
    assert found.elasticities["peak"]["gain"].value == pytest.approx(1.0, rel=1e-10)
    moved = influence(diagram, {"peak": peak, "iae": area}, ["signals.u.area"], commands=commands)
    for metric in ("peak", "iae"):
        assert moved.elasticities[metric]["signals.u.area"].value == pytest.approx(1.0, rel=1e-9)


def test_its_spectrum_is_the_frequency_response():
    found = transient(plant(), {"u": BLOW}, "y")
    omega = np.array([0.3, 2.0, 7.0])
    np.testing.assert_allclose(found.at(omega), 3.0 / (4 - omega**2 + 0.8j * omega), rtol=1e-9)


def test_a_search_finds_its_optimum_and_proves_it():
    """The peak grows with the gain: a bound of 1 is met at 2/peak(2)."""
    goals = (
        Goal(metric="peak", experiment="blow", output="y", upper=1.0),
        Goal(metric="iae", experiment="blow", output="y", sense=Sense.MAXIMIZE),
    )
    problem = Problem(
        diagram=plant(),
        variables=(Variable(parameter="gain", lower=0.5, upper=5.0),),
        experiments=(Experiment(name="blow", signals={"u": BLOW}),),
        goals=goals,
    )
    result = solve("gradient", problem, {"starts": 1, "seed": 1, "max_evaluations": 200})
    expected = 2.0 / float(answer(np.array([np.arctan2(W, 0.4) / W]))[0])
    assert result.best["gain"] == pytest.approx(expected, rel=1e-5)
    assert result.certificate.valid


@pytest.mark.parametrize(
    ("blocks", "wires", "output", "target"),
    [
        ({"g": block("gain", gain=2.0)}, ["u -> g"], "g", "y"),
        ({"d": block("delay", time=0.1), "i": block("integrator")}, ["u -> d", "d -> i"], "i", "a delay"),
        ({"s": block("saturation"), "i": block("integrator")}, ["u -> s", "s -> i"], "i", "s"),
    ],
)
def test_what_no_curve_can_show_is_refused(blocks, wires, output, target):
    diagram = compile_system(document({"u": block("input"), **blocks}, wires, {"y": output}))
    with pytest.raises(EngineError, match=f"an impulse at u must not go straight to {target} "):
        simulate(diagram, signals={"u": BLOW}, duration=1.0)


def test_copies_of_an_impulse_are_refused():
    with pytest.raises(EngineError, match="command must not be an impulse"):
        make("programmed_delay", {"delay": 0.1, "command": {"kind": "impulse"}})

"""Recorded inputs: many short steps at once give what single steps give, infinitesimals included."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.diagram.diagram import compile_system
from engine.exact.nonlinear import integrate
from engine.exact.nonlinear.recorded import simulate_recorded
from engine.model.tangent import INFINITESIMAL
from optimizers.identification import identify
from optimizers.problem import Variable
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording
from tests.unit.engine.diagrams import block, document

H = 0.005


def drive():
    """Return a mass with friction of two directions on a spring, behind a saturation."""
    return compile_system(
        document(
            {"u": block("input"), "s": block("saturation", lower=-6.0, upper=6.0), "n": block("sum", signs="+--"),
             "v": block("integrator", gain=0.5), "x": block("integrator"), "k": block("gain", gain=30.0),
             "f": block("friction", coulomb=1.0, static=1.3, viscous=2.0, coulomb_negative=1.6)},
            ["u -> s", "s -> n.in1", "f -> n.in2", "k -> n.in3", "n -> v", "v -> x", "x -> k", "v -> f"],
            {"x": "x", "v": "v"},
        )
    )  # fmt: skip


def command(samples: int) -> np.ndarray:
    t = H * np.arange(samples)
    return (8 * np.sin(3 * t) * np.sin(0.4 * t) + 0.3 * np.random.default_rng(1).standard_normal(samples))[None]


def test_many_steps_at_once_are_the_single_ones(monkeypatch):
    parameters = {
        "f.coulomb": INFINITESIMAL,
        "f.viscous": INFINITESIMAL,
        "v.gain": INFINITESIMAL,
        "s.upper": INFINITESIMAL,
    }
    made, inputs = drive(), command(240)
    values, slopes = simulate_recorded(made.laws(None, parameters), inputs, H)
    monkeypatch.setattr(integrate, "_FEWEST", 10**6)
    single, single_slopes = simulate_recorded(made.laws(None, parameters), inputs, H)
    np.testing.assert_allclose(values, single, atol=1e-8 * np.abs(single).max())
    for lane in range(4):
        np.testing.assert_allclose(slopes[lane], single_slopes[lane], atol=1e-6 * np.abs(single_slopes[lane]).max())
    h = 1e-6
    for lane, name in enumerate(list(parameters)[:2]):
        value = made.parameters[name].value
        up, down = (simulate_recorded(made.laws({name: value + s * h}), inputs, H)[0] for s in (1, -1))
        np.testing.assert_allclose(slopes[lane], (up - down) / (2 * h), atol=2e-3 * np.abs(slopes[lane]).max())


def test_friction_is_identified_from_a_recording():
    made, inputs = drive(), command(300)
    truth = {"f.coulomb": 0.8, "f.viscous": 2.6}
    measured, _ = simulate_recorded(made.laws(truth), inputs, H)
    recording = Recording(
        inputs={"u": inputs[0]}, outputs={"x": measured[0], "v": measured[1]}, sample_time=H,
    )  # fmt: skip
    problem = Identification(
        diagram=made, experiments=(RecordedExperiment(recording=recording, split=0.8),),
        parameters=(Variable(parameter="f.coulomb", lower=0.1, upper=1.25), Variable(parameter="f.viscous", lower=0.1)),
    )  # fmt: skip
    found = identify(problem, rng=np.random.default_rng(0))
    assert {name: estimate.value for name, estimate in found.parameters.items()} == pytest.approx(truth, rel=1e-5)


def test_a_law_alone_follows_a_recording():
    """Dahl's w' = ρ (v - |v| w) at a velocity of ever the same sign: 1 - w = e^(-ρ ∫v), whatever v is."""
    made = compile_system(
        document(
            {"u": block("input"), "d": block("mr_damper_dahl", damping=[0.0], friction=[60.0], rho=3.0)},
            ["u -> d.velocity"],
            {"f": "d"},
        )
    )
    speed = 0.1 + 0.05 * np.random.default_rng(2).random(200)
    speed[0] = 0.0
    force, _ = simulate_recorded(made.laws(), speed[None], H)
    way = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2) * H])
    np.testing.assert_allclose(force[0], 60 * (1 - np.exp(-3 * way)), atol=1e-9)


def test_an_input_that_rests_on_a_corner_does_not_make_a_table_chatter() -> None:
    """A valve that opens wider for lifting than for lowering: at each target the error rests on its corner.

    The recorded staircase of examples/data/hydraulic_bench; between two samples the error e obeys e' = s - k e, with s the
    slope of the reference and k the one of its side, which is solved by hand from corner to corner.
    """
    path = Path(__file__).parents[3] / "examples" / "data" / "hydraulic_bench" / "HangingLoad.csv"
    reference = np.loadtxt(path, delimiter=",", usecols=1, max_rows=3000)
    made = compile_system(
        document(
            {"r": block("input"), "e": block("sum", signs="+-"), "x": block("integrator"),
             "t": block("lookup_table", points=[-10.0, 0.0, 10.0], values=[-16.0, 0.0, 26.0], extrapolation="linear")},
            ["r -> e.in1", "x -> e.in2", "e -> t", "t -> x"],
            {"y": "x"},
        )
    )  # fmt: skip
    values, _ = simulate_recorded(made.laws(), reference[None], 0.02)
    error = np.zeros(reference.size)
    for i in range(1, reference.size):
        error[i] = glided(error[i - 1], (reference[i] - reference[i - 1]) / 0.02, 0.02)
    np.testing.assert_allclose(values[0], reference - error, atol=1e-7)


def glided(e: float, s: float, duration: float) -> float:
    """Return the solution of e' = s - k e after ``duration``, k 2.6 1/s above 0 and 1.6 1/s below."""
    while duration > 0:
        k = 2.6 if e > 0 or (e == 0 and s > 0) else 1.6
        steady = s / k
        # e goes from one side to the other only towards a steady error there
        crossing = -np.log(steady / (steady - e)) / k if e * steady < 0 else np.inf
        time = min(duration, crossing)
        e = 0.0 if crossing <= duration else steady + (e - steady) * np.exp(-k * time)
        duration -= time
    return e

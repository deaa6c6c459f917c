"""The part of a system between an input and an output, also where its states are of very different sizes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from engine.analysis.study import frequency_response
from engine.diagram.diagram import compile_system
from engine.exact.frequency.path import path
from engine.model.linear_system import LaneSystem
from tests.unit.engine.diagrams import block, document, response


@pytest.mark.parametrize("size", [1.0, 1e-9, 1e9])
def test_a_listening_state_of_any_size_is_no_hidden_one(size):
    # A fast lag drives an integrator in small units: y/u = size / (s (1 + s/1e5)), which no cancellation shortens.
    system = compile_system(
        document(
            {
                "u": block("input"),
                "fast": block("transfer_function", numerator=[1.0], denominator=[1e-5, 1.0]),
                "slow": block("integrator", gain=size),
                "back": block("gain", gain=1 / size),
            },
            ["u -> fast", "fast -> slow", "slow -> back"],
            {"y": "back"},
        )
    ).realize()
    part = path(LaneSystem.of([system]), [0], [0])
    assert part.n == 2


def test_an_uncancelled_s_over_s_is_hidden():
    # s/s² · 1/(1 + s): the integrator cancels, and what remains of it is 1/s (1/(1 + s)) of order 2.
    system = compile_system(
        document(
            {
                "u": block("input"),
                "plant": block("transfer_function", numerator=[1.0, 0.0], denominator=[1.0, 1.0, 0.0, 0.0]),
            },
            ["u -> plant"],
            {"y": "plant"},
        )
    ).realize()
    assert path(LaneSystem.of([system]), [0], [0]).n == 2


def test_an_opened_position_loop_in_si_keeps_its_gain():
    # Six states from 1e-9 (a pressure gain) to 4e4 rad/s (an amplifier): the opened loop integrates, and crosses 1 near
    # its gain of 12 rad/s. Expected: the product of the blocks' formulas.
    blocks = {
        "r": block("input"),
        "error": block("sum", signs="+-"),
        "gain": block("gain", gain=12.0),
        "amplifier": block("low_pass", frequency=4e4, order=1),
        "pump": block("low_pass", frequency=2e3, order=2, damping_ratio=0.7),
        "pressure": block("transfer_function", numerator=[1e9], denominator=[1e-3, 1.0]),
        "cylinder": block("transfer_function", numerator=[1e-9], denominator=[1e-2, 1.0]),
        "position": block("integrator"),
    }
    order = [*blocks][2:]
    wires = ["r -> error.in1", "position -> error.in2", "error -> gain"]
    wires += [f"{first} -> {second}" for first, second in itertools.pairwise(order)]
    diagram = compile_system(document(blocks, wires, {"position": "position"}))

    def loop(s: complex) -> complex:
        pump = 1 / (1 + 1.4 * s / 2e3 + s**2 / 4e6)
        return 12 / s / (1 + s / 4e4) * pump / (1 + 1e-3 * s) / (1 + 1e-2 * s)

    frequencies = np.array([0.1, 5.0, 12.0, 300.0])
    study = frequency_response(diagram, open_at="error", frequencies=frequencies)
    np.testing.assert_allclose(study.response, [loop(1j * w) for w in frequencies], rtol=1e-12)
    opened = diagram.realize(open_at="error")
    assert -response(opened, 5j, "loop", "loop") == pytest.approx(loop(5j), rel=1e-12)
    ((frequency, margin),) = study.margins.phase
    assert abs(loop(1j * frequency)) == pytest.approx(1.0, rel=1e-10)
    assert margin == pytest.approx(np.pi + np.angle(loop(1j * frequency)), rel=1e-9)


def test_a_loop_that_lets_nothing_through_has_frequencies_too():
    # A valve that is closed at rest: its response is 0 everywhere, and no frequency is better than another.
    blocks = {
        "r": block("input"),
        "error": block("sum", signs="+-"),
        "valve": block("gain", gain=0.0),
        "motor": block("integrator"),
    }
    wires = ["r -> error.in1", "motor -> error.in2", "error -> valve", "valve -> motor"]
    study = frequency_response(compile_system(document(blocks, wires, {"y": "motor"})), open_at="error", metrics=())
    assert study.frequency[0] < study.frequency[-1]
    assert np.all(study.response == 0)

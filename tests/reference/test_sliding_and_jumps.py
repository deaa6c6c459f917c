"""A law that slides lets go where its input jumps: the same response wherever on the axis of time, and as another law that means the same."""

from __future__ import annotations

import numpy as np
import pytest

from engine.diagram.diagram import Diagram, compile_system
from engine.exact.nonlinear.integrate import Integration
from engine.model.verdicts import Verdict
from engine.signals import Signal, make
from tests.reference.event_driven._relay import Relayed
from tests.unit.engine.diagrams import block, document

LATE = 0.3


def response(diagram: Diagram, signals: dict[str, Signal], times: np.ndarray) -> np.ndarray:
    """Return the outputs at some instants, (outputs, times)."""
    outcome = Integration(diagram.laws(), signals).advance(float(times[-1]))
    assert outcome.verdict is Verdict.OK, outcome.advice
    return np.array([outcome.output(k).sample(times) for k in range(len(diagram.outputs))])


@pytest.mark.parametrize("seed", [2, 5, 22, 27, 29])
def test_a_relay_that_slides_at_rest_follows_a_late_step_as_an_early_one(seed):
    """Its state of rest is the surface itself, on which it slides; the equations do not know the time."""
    loop = Relayed.random(np.random.default_rng(seed))
    assert loop.p["h"] == 0
    assert loop.command.kind == "step"
    times = np.linspace(0.0, loop.duration, 201)
    early = response(loop.diagram(), {"r": make("step", {"amplitude": loop.command.size})}, times)
    late = response(loop.diagram(), {"r": make("step", {"amplitude": loop.command.size, "start": LATE})}, LATE + times)
    size = np.abs(early).max(axis=1, keepdims=True)
    # the relay's own output jumps: where it does so the two differ by the rounding of an instant
    np.testing.assert_allclose(late[:2] / size[:2], early[:2] / size[:2], atol=1e-8)


def held_at_an_edge(law: str, edge: float, values: dict[str, float]) -> Diagram:
    """Return v' = r - u - v/2 under a law that sees v - a + b and drives it back to ``edge``; b is a step that comes in with the edge."""
    blocks = {
        "r": block("input"), "a": block("input"), "one": block("input"), "edge": block("gain", gain=0.5 - edge),
        "s": block("sum", signs="+--"), "law": block(law, **values), "net": block("sum", signs="+--"),
        "v": block("integrator"), "drag": block("gain", gain=0.5),
    }  # fmt: skip
    wires = [
        "r -> net.in1", "law -> net.in2", "v -> drag", "drag -> net.in3", "net -> v", "v -> s.in1", "a -> s.in2",
        "one -> edge", "edge -> s.in3", "s -> law",
    ]  # fmt: skip
    return compile_system(document(blocks, wires, {"v": "v", "u": "law"}))


@pytest.mark.parametrize("height", [0.05, 0.12])
def test_a_quantizer_between_two_levels_is_a_relay(height):
    """A quantizer of step 1 whose input stays between -1/2 and 3/2 is a relay of 0 and 1 at 1/2, held there and torn off by jumps."""
    times = np.linspace(0.0, 6.0, 601)
    signals = {
        "r": make("step", {"amplitude": 0.8}), "a": make("square", {"amplitude": height, "period": 2.2}),
        "one": make("step", {}),
    }  # fmt: skip
    quantized = response(held_at_an_edge("quantizer", 0.5, {"step": 1.0}), signals, times)
    relay = held_at_an_edge("relay", 0.0, {"low": 0.0, "high": 1.0, "hysteresis": 0.0})
    switched = response(relay, signals, times)
    slides = (quantized[1] > 0.01) & (quantized[1] < 0.99)
    assert 100 < slides.sum() < 550
    assert np.abs(np.diff(slides.astype(int))).sum() >= 6  # torn off by each jump, and held again
    np.testing.assert_allclose(quantized[0], switched[0], atol=1e-8)

"""A relay, a quantizer and a limit give their levels exactly, wherever a curve is sampled."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.study import Simulation, simulate
from engine.diagram.diagram import Diagram, compile_system
from engine.exact.time.chebyshev import DEGREE
from engine.exact.time.curve import Curve
from engine.signals import make
from tests.unit.engine.diagrams import block, document

LAWS = {
    "relay": ({"low": -0.3, "high": 0.7, "hysteresis": 0.02}, {-0.3, 0.7}),
    "quantizer": ({"step": 0.1}, {0.1 * k for k in range(-80, 81)}),
}


def loop(kind: str, values: dict[str, float], *, curved: bool) -> Diagram:
    """Return a law in a position loop with a gain that has no short binary form; on a curved path the plant is no linear map."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "k": block("gain", gain=7.3), "law": block(kind, **values),
        "p": block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0, 0.0]),
        "f": block("friction", coulomb=0.01, viscous=0.1, static=0.02, stribeck_velocity=0.1, transition_velocity=0.05),
        "n": block("sum", signs="+-"),
    }  # fmt: skip
    wires = ["r -> e.in1", "p -> e.in2", "e -> k", "k -> law"]
    wires += ["law -> n.in1", "p -> f", "f -> n.in2", "n -> p"] if curved else ["law -> p"]
    if not curved:
        del blocks["f"], blocks["n"]
    return compile_system(document(blocks, wires, {"y": "p", "u": "law"}))


def run(made: Diagram, *metrics: str) -> Simulation:
    return simulate(made, signals={"r": make("step", {})}, duration=6.0, samples=7001, metrics=metrics)


@pytest.mark.parametrize("curved", [False, True], ids=["straight", "curved"])
@pytest.mark.parametrize("kind", LAWS)
def test_every_sample_is_a_level(kind: str, curved: bool) -> None:
    values, levels = LAWS[kind]
    found = run(loop(kind, values, curved=curved))
    assert len(set(found.curves["u"].tolist())) > 1
    assert set(found.curves["u"].tolist()) <= levels


def test_what_stands_at_its_limit_from_the_beginning_peaks_there() -> None:
    values = {"lower": -0.3, "upper": 0.7}
    found = run(loop("saturation", values, curved=False), "peak", "peak_time")
    assert found.curves["u"].max() == 0.7
    assert found.metrics["u"]["peak"].value == 0.7
    assert found.metrics["u"]["peak_time"].value == 0.0


def test_a_level_between_nodes_is_that_level() -> None:
    curve = Curve(edges=np.array([[0.0], [1.0], [2.0]]), values=np.repeat([[[0.1]], [[0.7]]], DEGREE + 1, axis=1))
    assert set(curve.sample(np.linspace(0.0, 2.0, 999)).tolist()) == {0.1, 0.7}

"""Input at and beyond the edge of what is allowed: bounds of every element, empty polynomials, odd delays, 500 blocks."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.optimize import brentq
from scipy.stats import gamma

from engine.diagram import Diagram, compile_system
from engine.elements import catalogue
from engine.errors import DiagramError
from engine.parameters import Param
from engine.signals import make
from engine.study import simulate
from tests.unit.engine.diagrams import block, document

INSTEAD = {
    "integral_time": ("ki",),
    "derivative_time": ("kd",),
    "time_constant": ("natural_frequency", "damping_ratio"),
}
"""What of an element's example a parameter stands in place of."""
BESIDE = {("ball_screw", "damping"): {"stiffness": 1e8}}
"""What a parameter is given with only."""


def beyond(param: Param) -> list[float]:
    """Return a value beyond each finite bound."""
    below = [param.lower if param.lower_open else param.lower - 1.0] if math.isfinite(param.lower) else []
    return below + ([param.upper + 1.0] if math.isfinite(param.upper) else [])


@pytest.mark.parametrize("kind", catalogue())
def test_every_bound_of_every_element_holds(kind: str) -> None:
    element = catalogue()[kind]
    scalars = [param for param in element.parameters if param.shape == "scalar"]
    for name, value in [(param.name, value) for param in scalars for value in beyond(param)]:
        given = {key: own for key, own in element.example.items() if key not in INSTEAD.get(name, ())}
        given |= {**BESIDE.get((kind, name), {}), name: value}
        with pytest.raises(DiagramError) as caught:
            compile_system(document({"it": block(kind, **given)}))
        assert "must be" in caught.value.message
        assert f"{value:g}" in caught.value.message
        assert caught.value.at[:2] == ("blocks", "it")


def test_an_empty_numerator_is_refused_and_0_is_a_number() -> None:
    with pytest.raises(DiagramError, match="numerator must have a coefficient") as caught:
        compile_system(document({"g": block("transfer_function", numerator=[], denominator=[1.0, 1.0])}))
    assert caught.value.at == ("blocks", "g", "numerator")
    compile_system(document({"g": block("transfer_function", numerator=[0.0], denominator=[1.0, 1.0])}))


def loop(delay: float) -> Diagram:
    """Return 0.5 e^{-s delay}/(s + 1), closed."""
    blocks = {
        "r": block("input"),
        "e": block("sum", signs="+-"),
        "late": block("delay", time=delay),
        "lag": block("transfer_function", numerator=[0.5], denominator=[1.0, 1.0]),
    }
    return compile_system(document(blocks, ["r -> e.in1", "lag -> e.in2", "e -> late", "late -> lag"], {"y": "lag"}))


def test_a_loop_with_a_delay_a_thousand_times_its_lag_goes_step_by_step() -> None:
    # during each delay the lag settles at half of what the error was: 1/2, 1/4, 3/8, 5/16, ... towards 1/3
    done = simulate(loop(1e3), signals={"r": make("step", {})}, outputs=["y"], duration=5e3, samples=5001)
    assert (done.curves["y"][done.time <= 1e3] == 0.0).all()
    assert done.curves["y"][[1900, 2900, 3900, 4900]] == pytest.approx([1 / 2, 1 / 4, 3 / 8, 5 / 16], abs=1e-7)
    assert done.metrics["y"]["overshoot"].value == pytest.approx(0.5, abs=1e-9)
    # y - 1/3 = c + e^-t p(t) during each delay, with c_n = -c_{n-1}/2, p_n' = -p_{n-1}/2: in the band of 2 % for good in the 7th
    c, p = -1 / 3, Polynomial([0.0])
    for _ in range(6):
        c, p = -c / 2, (p.integ() * -0.5) + 1.5 * c
    last = brentq(lambda t: abs(c + math.exp(-t) * p(t)) - 0.02 / 3, 3.0, 6.0)
    assert done.metrics["y"]["settling_time"].value == pytest.approx(6e3 + last, rel=1e-9)


def test_a_loop_with_a_delay_of_a_picosecond_is_the_loop_without() -> None:
    found = simulate(
        loop(1e-12), signals={"r": make("step", {})}, outputs=["y"], metrics=["rise_time", "settling_time"]
    )
    # 0.5/(s + 1.5)
    assert found.metrics["y"]["rise_time"].value == pytest.approx(math.log(9) / 1.5, rel=1e-9)
    assert found.metrics["y"]["settling_time"].value == pytest.approx(math.log(50) / 1.5, rel=1e-9)


def test_five_hundred_blocks_are_answered() -> None:
    # 60 equal lags in a row: the response is the distribution of Erlang
    lags = {f"lag{k}": block("transfer_function", numerator=[1.0], denominator=[0.1, 1.0]) for k in range(60)}
    gains = {f"gain{k}": block("gain", gain=2.0 if k % 2 else 0.5) for k in range(438)}
    chain = ["e", *gains, *lags]
    wires = ["u -> e", *(f"{a} -> {b}" for a, b in itertools.pairwise(chain))]
    blocks = {"u": block("input"), "e": block("sum", signs="+"), **gains, **lags}
    assert len(blocks) == 500
    diagram = compile_system(document(blocks, wires, {"y": chain[-1]}))
    found = simulate(diagram, signals={"u": make("step", {})}, outputs=["y"], metrics=["rise_time", "overshoot"])
    first, last = gamma.ppf([0.1, 0.9], 60, scale=0.1)
    assert found.metrics["y"]["rise_time"].value == pytest.approx(last - first, rel=1e-9)
    assert found.metrics["y"]["overshoot"].value == 0.0
    assert np.isfinite(found.curves["y"]).all()

"""Input at and beyond the edge of what is allowed: bounds of every element, empty polynomials, odd delays, 500 blocks."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.optimize import brentq
from scipy.stats import gamma

from engine.analysis.study import frequency_response, simulate
from engine.diagram.diagram import Diagram, compile_system
from engine.elements import catalogue
from engine.elements._nonlinear import NonlinearElement
from engine.model.errors import DiagramError
from engine.model.parameters import Param
from engine.signals import make
from tests.unit.engine.diagrams import block, document

INSTEAD = {
    "integral_time": ("ki",),
    "derivative_time": ("kd",),
    "time_constant": ("natural_frequency", "damping_ratio"),
}
"""What of an element's example a parameter stands in place of."""
LINEAR = [kind for kind, e in catalogue().items() if not issubclass(e, NonlinearElement) and kind != "input"]
BESIDE = {
    ("ball_screw", "damping"): {"stiffness": 1e8},
    ("pi", "tracking_time"): {"upper": 1.0, "anti_windup": "back_calculation"},
    ("pid", "tracking_time"): {"upper": 1.0, "anti_windup": "back_calculation"},
    ("sampled_pid", "tracking_time"): {"upper": 1.0, "anti_windup": "back_calculation"},
}
"""What a parameter is given with only."""


def beyond(param: Param) -> list[float]:
    """Return a value beyond each finite bound, and numbers that nothing can be computed with."""
    below = [param.lower if param.lower_open else param.lower - 1.0] if math.isfinite(param.lower) else []
    above = [param.upper + 1.0] if math.isfinite(param.upper) else []
    return [*below, *above, -1e308, 1e308, 1e-308, math.nan, math.inf, -math.inf]


@pytest.mark.parametrize("kind", catalogue())
def test_every_bound_of_every_element_holds(kind: str) -> None:
    element = catalogue()[kind]
    scalars = [param for param in element.parameters if param.shape == "scalar"]
    for param, value in itertools.chain.from_iterable(zip(itertools.repeat(p), beyond(p)) for p in scalars):
        name = param.name
        given = {key: own for key, own in element.example.items() if key not in INSTEAD.get(name, ())}
        given |= {**BESIDE.get((kind, name), {}), name: value}
        with pytest.raises(DiagramError) as caught:
            compile_system(document({"it": block(kind, **given)}))
        assert "must be" in caught.value.message
        assert f"{value:g}" in caught.value.message
        assert param.unit in ("", "1") or not math.isfinite(value) or param.unit in caught.value.message
        assert caught.value.at[:2] == ("blocks", "it")


@pytest.mark.parametrize("value", [1e-12, 1e3])
@pytest.mark.parametrize("kind", LINEAR)
def test_every_parameter_far_from_its_usual_size_gets_an_answer_or_a_named_error(kind: str, value: float) -> None:
    element = catalogue()[kind]
    for param in (param for param in element.parameters if param.shape == "scalar"):
        given = {key: own for key, own in element.example.items() if key not in INSTEAD.get(param.name, ())}
        given |= {**BESIDE.get((kind, param.name), {}), param.name: value}
        values = {each.name: each.default for each in element.parameters} | given
        ports = element.ports(values)
        inputs = {f"u{k}": block("input") for k in range(len(ports.inputs))}
        wires = [f"u{k} -> it.{port}" for k, port in enumerate(ports.inputs)]
        blocks = {**inputs, "it": block(kind, **given)}
        if not param.admits(value):
            with pytest.raises(DiagramError, match=f"it.{param.name} must be "):
                compile_system(document(blocks, wires, {"y": f"it.{ports.outputs[0]}"}))
            continue
        diagram = compile_system(document(blocks, wires, {"y": f"it.{ports.outputs[0]}"}))
        study = frequency_response(diagram, source="u0", target="y", metrics=[], frequencies=np.geomspace(0.1, 1e3, 9))
        assert np.isfinite(study.response).all(), param.name


def test_an_empty_numerator_is_refused_and_0_is_a_number() -> None:
    with pytest.raises(DiagramError, match="numerator must have a coefficient") as caught:
        compile_system(document({"g": block("transfer_function", numerator=[], denominator=[1.0, 1.0])}))
    assert caught.value.at == ("blocks", "g", "numerator")
    compile_system(document({"g": block("transfer_function", numerator=[0.0], denominator=[1.0, 1.0])}))


@pytest.mark.parametrize("order", [0, 9, 2.5, 10**400, -(10**400), math.nan, math.inf, True, "2"])
def test_an_order_beyond_its_bounds_is_refused(order: object) -> None:
    with pytest.raises(DiagramError, match=r"it\.order must be a whole number >= 1 and <= 8, got "):
        compile_system(document({"it": block("low_pass", frequency=1.0, order=order)}))


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


@pytest.mark.parametrize(
    ("delay", "rule"),
    [
        (1e308, "<= 1e+06 s in size"), (2e6, "<= 1e+06 s in size"), (1e-308, "0 or >= 1e-100 s in size"),
        (math.nan, "finite"), (math.inf, "finite"), (-1e-12, ">= 0 s"),
    ],
)  # fmt: skip
def test_a_delay_beyond_arithmetic_is_refused(delay: float, rule: str) -> None:
    with pytest.raises(DiagramError) as caught:
        loop(delay)
    assert caught.value.message == f"late.time must be {rule}, got {delay:g}"


def test_a_delay_of_nearly_nothing_is_answered() -> None:
    found = simulate(loop(1e-30), signals={"r": make("step", {})}, outputs=["y"], metrics=["rise_time"])
    assert found.metrics["y"]["rise_time"].value == pytest.approx(math.log(9) / 1.5, rel=1e-9)


def test_a_path_that_carries_nothing_has_a_frequency_response_of_zero() -> None:
    silent = compile_system(document({"u": block("input"), "g": block("gain", gain=0.0)}, ["u -> g"], {"y": "g"}))
    study = frequency_response(silent, source="u", target="y")
    assert len(study.frequency) > 1
    assert not study.response.any()


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

"""Elasticities that follow from powers, and the word that stands where there is none."""

from __future__ import annotations

import pytest

from engine.analysis.influence import Influence, influence
from engine.analysis.measuring import MetricRequest
from engine.diagram.diagram import Diagram, compile_system
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document


def of_step(diagram: Diagram, parameters: list[str], *metrics: str, change: float = 0.1) -> Influence:
    step = {"u": make("step", {})}
    requests = {name: MetricRequest(metric=name, signals=step, output="y") for name in metrics}
    return influence(diagram, requests, parameters, change=change)


def test_parameters_of_blocks_of_the_system_and_of_expressions_move_by_their_powers() -> None:
    # g/(T s + 1), T = a b²: the rise time is T ln 9, the largest value g, so that every elasticity is a power
    diagram = compile_system(
        document(
            {"u": block("input"), "g": block("gain", gain=3.0), "lag": block("first_order_sensor", time_constant="=a*b**2")},
            ["u -> g", "g -> lag"],
            {"y": "lag"},
            a=2.0,
            b=0.5,
        )
    )  # fmt: skip
    found = of_step(diagram, ["a", "b", "g.gain"], "rise_time", "peak", "overshoot")
    powers = {"rise_time": (1.0, 2.0, 0.0), "peak": (0.0, 0.0, 1.0)}
    for metric, expected in powers.items():
        cells = found.elasticities[metric]
        assert [cells[name].value for name in ("a", "b", "g.gain")] == pytest.approx(expected, abs=1e-9)
        assert {cell.verdict for cell in cells.values()} == {Verdict.OK}
    # eq. (4) of x -> x^2 for a change of 10 %: (1 - 1.21)/(1 - 1.1)
    assert found.coefficients["rise_time"]["b"].value == pytest.approx(2.1, rel=1e-9)
    # nothing can be told relative to an overshoot of 0
    assert {cell.value for cell in found.elasticities["overshoot"].values()} == {None}
    assert {cell.verdict for cell in found.elasticities["overshoot"].values()} == {Verdict.ZERO_BASE}
    assert {cell.verdict for cell in found.coefficients["overshoot"].values()} == {Verdict.ZERO_BASE}


def test_what_does_not_move_a_metric_is_not_its_strongest_lever() -> None:
    # the gain scales the response, the time constant stretches it: each leaves the metrics of the other alone
    blocks = {"u": block("input"), "p": block("transfer_function", numerator=["=k"], denominator=["=t", 1.0])}
    diagram = compile_system(document(blocks, ["u -> p"], {"y": "p"}, k=3.0, t=0.7))
    found = of_step(diagram, ["k", "t"], "rise_time", "peak")
    assert found.by_metric == {"rise_time": "t", "peak": "k"}
    assert found.by_parameter == {"t": "rise_time", "k": "peak"}
    found = of_step(diagram, ["k"], "rise_time")
    assert (found.by_metric, found.by_parameter) == ({}, {})


def test_what_an_unstable_system_does_not_have_has_no_elasticity_either() -> None:
    blocks = {"u": block("input"), "p": block("transfer_function", numerator=["=k"], denominator=[1.0, -1.0])}
    found = of_step(compile_system(document(blocks, ["u -> p"], {"y": "p"}, k=1.0)), ["k"], "rise_time")
    for cell in (found.elasticities["rise_time"]["k"], found.coefficients["rise_time"]["k"]):
        assert (cell.value, cell.verdict) == (None, Verdict.UNSTABLE)


def test_a_change_into_instability_has_an_elasticity_and_no_coefficient() -> None:
    # k/(s (s + 1)²) is stable up to k = 2
    blocks = {
        "u": block("input"),
        "e": block("sum", signs="+-"),
        "p": block("transfer_function", numerator=["=k"], denominator=[1.0, 2.0, 1.0, 0.0]),
    }
    diagram = compile_system(document(blocks, ["u -> e.in1", "p -> e.in2", "e -> p"], {"y": "p"}, k=1.9))
    found = of_step(diagram, ["k"], "rise_time")
    assert found.elasticities["rise_time"]["k"].verdict is Verdict.OK
    cell = found.coefficients["rise_time"]["k"]
    assert (cell.value, cell.final, cell.verdict) == (None, None, Verdict.UNSTABLE)


def test_a_margin_that_does_not_exist_says_why() -> None:
    blocks = {
        "u": block("input"),
        "e": block("sum", signs="+-"),
        "p": block("transfer_function", numerator=["=k"], denominator=[1.0, 1.0]),
    }
    diagram = compile_system(document(blocks, ["u -> e.in1", "p -> e.in2", "e -> p"], {"y": "p"}, k=0.5))
    margins = {name: MetricRequest(metric=name, open_at="e") for name in ("gain_margin", "phase_margin")}
    found = influence(diagram, margins, ["k"])
    for name in margins:  # |L| < 1 everywhere, and a phase that never reaches -180°
        assert found.elasticities[name]["k"].value is None
        assert found.elasticities[name]["k"].verdict is Verdict.NEVER_CROSSES

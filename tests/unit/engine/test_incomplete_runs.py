"""A run that ends before its time has no metric: x' = a + x² is √a tan(√a t), which ends at π/(2 √a)."""

from __future__ import annotations

import math

import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import simulate
from engine.diagram.diagram import Diagram, compile_system
from engine.exact.nonlinear import bounds
from engine.metrics import catalogue
from engine.metrics._base import TimeMetric
from engine.model.masks import Envelope, Polyline
from engine.model.metric_options import Options
from engine.model.verdicts import Measured, Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

STEP = {"r": make("step", {})}
LINE = Polyline(times=(0.0, 0.1), values=(0.0, 1.0))
MASKS = {"envelope": Envelope(upper=LINE), "reference": LINE}


def escaping() -> Diagram:
    """x' = a r + x²."""
    blocks = {
        "r": block("input"), "a": block("gain", gain="=a"), "n": block("sum", signs="++"),
        "p": block("multiplication"), "x": block("integrator"),
    }  # fmt: skip
    wires = ["r -> a", "a -> n.in1", "p -> n.in2", "n -> x", "x -> p.in1", "x -> p.in2"]
    return compile_system(document(blocks, wires, {"y": "x"}, a=1.0))


def twisting() -> Diagram:
    """x'' = -sign(x) - sign(x')/2 switches infinitely often before it comes to rest."""
    blocks = {
        "r": block("input"), "a": block("relay"), "b": block("relay", low=-0.5, high=0.5, hysteresis=1e-12),
        "n": block("sum", signs="+--"), "v": block("integrator"), "x": block("integrator", initial=1.0),
    }  # fmt: skip
    wires = ["r -> n.in1", "a -> n.in2", "b -> n.in3", "n -> v", "v -> x", "x -> a", "v -> b"]
    return compile_system(document(blocks, wires, {"y": "x"}))


def runaway() -> Diagram:
    """x' = r + 100 x: linear, and e^1000 after 10 s."""
    lag = block("transfer_function", numerator=[1.0], denominator=[1.0, -100.0])
    return compile_system(document({"r": block("input"), "x": lag}, ["r -> x"], {"y": "x"}))


def every(diagram: Diagram, duration: float | None) -> dict[str, Measured]:
    """Return every metric in time of the output."""
    requests = [
        MetricRequest(
            metric=kind,
            signals=STEP,
            output="y",
            duration=duration,
            band=(0.1, 10.0),
            mask=MASKS.get(metric.mask),
            options=Options(recovery_band=0.1, derivative=0),
        )
        for kind, metric in catalogue().items()
        if issubclass(metric, TimeMetric)
    ]
    found = measure(diagram, requests)
    return {request.metric: measured for request, (measured, _) in zip(requests, found, strict=True)}


@pytest.mark.parametrize(
    ("diagram", "duration", "verdict", "says"),
    [
        (escaping(), 3.0, Verdict.UNSTABLE, "the run ends at 1.5708 s of 3 s"),
        (escaping(), None, Verdict.UNSTABLE, "the run ends at 1.5708 s before it has settled"),
        (twisting(), 20.0, Verdict.DOUBTFUL, "s of 20 s: events of"),
        (runaway(), 10.0, Verdict.UNSTABLE, "grows beyond 1e+100 within its 10 s"),
    ],
)
def test_nothing_is_measured_on_a_part_of_a_run(diagram, duration, verdict, says):
    for metric, found in every(diagram, duration).items():
        assert (found.value, found.verdict) == (None, verdict), metric
        assert says in found.advice, metric


def test_nor_on_one_that_takes_too_many_steps(monkeypatch):
    monkeypatch.setattr(bounds, "MAX_STEPS", 3)
    for metric, found in every(escaping(), 1.5).items():
        assert (found.value, found.verdict) == (None, Verdict.TOO_SHORT), metric
        assert "s of 1.5 s" in found.advice, metric


def test_a_run_that_comes_to_its_end_just_before_has_its_integrals():
    """∫|1 - tan t| from 0 to T is π/2 + ln(1/2) - T - ln cos T for T > π/4."""
    end = 1.57
    found = simulate(escaping(), signals=STEP, duration=end)
    exact = math.pi / 2 - math.log(2) - end - math.log(math.cos(end))
    assert found.metrics["y"]["iae"].value == pytest.approx(exact, rel=1e-9)
    assert found.metrics["y"]["iae"].verdict is Verdict.OK


def test_nor_has_it_a_derivative():
    request = MetricRequest(metric="iae", signals=STEP, output="y", duration=3.0)
    ((found, gradient),) = measure(escaping(), [request], gradient=["a"])
    assert (found.value, found.verdict, gradient) == (None, Verdict.UNSTABLE, None)

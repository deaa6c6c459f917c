"""Largest values within a duration: whatever comes later, they are those of the window, by closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram, compile_system
from engine.model.metric_options import Options
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

LARGEST = ("peak", "max_velocity", "max_acceleration", "control_effort")
STEP, RAMP = make("step", {}), make("ramp", {"slope": 1.0})


def plant(numerator, denominator, *, limited: bool = False) -> Diagram:
    blocks = {"u": block("input"), "p": block("transfer_function", numerator=numerator, denominator=denominator)}
    wires = ["u -> p"]
    if limited:  # never reached
        blocks["s"] = block("saturation", lower=-100.0, upper=100.0)
        wires = ["u -> s", "s -> p"]
    return compile_system(document(blocks, wires, {"y": "p"}, k=2.0))


@pytest.mark.parametrize("limited", [False, True])
@pytest.mark.parametrize(
    ("denominator", "signal", "expected"),
    [
        ([1.0, 1.0], RAMP, 2 * (2 + np.exp(-3))),  # grows without end
        ([1.0, 1.0], STEP, 2 * (1 - np.exp(-3))),  # settles at 2, later
        ([1.0, 0.0], STEP, 6.0),  # integrates
        ([1.0, 0.0, 1.0], STEP, 2 * (1 - np.cos(3))),  # swings without end; its peak comes after π s
        ([1.0, -1.0], STEP, 2 * (np.exp(3) - 1)),  # unstable
    ],
)
def test_the_largest_value_is_that_of_the_window(denominator, signal, expected, limited):
    made = plant(["=k"], denominator, limited=limited)
    asked = [
        MetricRequest(metric=m, signals={"u": signal}, output="y", duration=3.0, options=Options(derivative=0))
        for m in (*LARGEST, "peak_time")
    ]
    found = measure(made, asked, gradient=["k"])
    for measured, slopes in found[:-1]:
        assert measured.value == pytest.approx(expected, rel=1e-9)
        assert slopes.values[0] == pytest.approx(expected / 2, rel=1e-9)
    assert found[-1][0].value == pytest.approx(3.0, rel=1e-12)


def test_a_peak_within_the_window_is_found_at_its_instant():
    """1/(s² + 0.4 s + 1): 1 + exp(-π 0.2/√0.96) at π/√0.96."""
    made = plant([1.0], [1.0, 0.4, 1.0])
    asked = [MetricRequest(metric=m, signals={"u": STEP}, output="y", duration=4.0) for m in ("peak", "peak_time")]
    (peak, _), (at, _) = measure(made, asked)
    assert peak.value == pytest.approx(1 + np.exp(-np.pi * 0.2 / np.sqrt(0.96)), rel=1e-12)
    assert at.value == pytest.approx(np.pi / np.sqrt(0.96), rel=1e-12)
    assert peak.verdict is at.verdict is Verdict.OK


@pytest.mark.parametrize("limited", [False, True])
def test_what_ranks_candidates_looks_no_further(limited):
    """What is not doubted is of the window."""
    made = plant(["=k"], [1.0, 1.0], limited=limited)
    request = MetricRequest(metric="peak", signals={"u": STEP}, output="y", duration=1.0)
    found = Screening(made, [request])({"k": np.array([1.0, 3.0])})
    told = found.values[:, 0][~found.doubtful[:, 0]]
    expected = np.array([1.0, 3.0])[~found.doubtful[:, 0]] * (1 - np.exp(-1))
    np.testing.assert_allclose(told, expected, rtol=1e-4)

"""The larger of two peaks of one height has a kink: each has a slope of its own, so that an elasticity holds on one side only."""

from __future__ import annotations

import math
from typing import Any

import pytest

from engine.analysis.study import MetricRequest, measure
from engine.diagram.diagram import Diagram
from tests.reference.measuring import step
from tests.reference.systems import block, system


def parallel(first: dict[str, Any], second: dict[str, Any], signs: str) -> Diagram:
    """u -> both (a first + b second) -> y."""
    wires = ["u -> both", "both -> one", "both -> other", "one -> a", "other -> b", "a -> s.in1", "b -> s.in2"]
    blocks = {
        "u": block("input"), "one": block(**first), "other": block(**second), "s": block("sum", signs=signs),
        "a": block("gain", gain="=a"), "b": block("gain", gain="=b"), "both": block("gain", gain="=both"),
    }  # fmt: skip
    return system(blocks, wires, {"y": "s"}, {"a": 1.0, "b": 1.0, "both": 1.0})


def band_pass(centre: float) -> dict[str, Any]:
    return {
        "kind": "transfer_function", "numerator": [0.2 * centre, 0.0], "denominator": [1.0, 0.2 * centre, centre**2],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("b", "kinked", "nearly"), [(0.9, False, (1.0, 0.0)), (1.0, True, None), (1.1, False, (0.0, 1.0))]
)
def test_two_resonances_of_one_height(b: float, kinked: bool, nearly: tuple[float, float] | None) -> None:
    # |G(jω)| = |G(j/ω)| with a = b: the one band-pass is the other, seen in 1/ω
    request = MetricRequest(metric="compliance_peak", source="u", target="y")
    diagram = parallel(band_pass(0.01), band_pass(100.0), "++")
    ((peak, gradient),) = measure(diagram, [request], overrides={"b": b}, gradient=["a", "b"])
    assert gradient is not None
    assert gradient.one_sided is kinked
    assert peak.value == pytest.approx(max(1.0, b), abs=1e-3)
    if nearly:
        assert gradient.values == pytest.approx(nearly, abs=1e-3)


@pytest.mark.parametrize("metric", ["peak", "control_effort"])
@pytest.mark.parametrize(("b", "kinked"), [(0.9, False), (1.0, True), (1.1, False)])
def test_a_high_and_a_low_of_one_size(metric: str, b: float, kinked: bool) -> None:
    # the same movement again, 40 s later and downwards: the largest value is max(a, b) times its own
    once = {"kind": "transfer_function", "numerator": [1.0, 0.0], "denominator": [1.0, 2.0, 1.0]}
    later = {"kind": "delay", "time": 40.0}
    blocks = {
        "u": block("input"), "once": block(**once), "later": block(**later), "s": block("sum", signs="+-"),
        "a": block("gain", gain="=a"), "b": block("gain", gain="=b"),
    }  # fmt: skip
    wires = ["u -> once", "once -> a", "once -> later", "later -> b", "a -> s.in1", "b -> s.in2"]
    diagram = system(blocks, wires, {"y": "s"}, {"a": 1.0, "b": 1.0})
    request = MetricRequest(metric=metric, signals={"u": step()}, output="y")
    ((peak, gradient),) = measure(diagram, [request], overrides={"b": b}, gradient=["a", "b"])
    assert gradient is not None
    assert gradient.one_sided is kinked
    # t e^-t is largest at 1 s
    assert peak.value == pytest.approx(max(1.0, b) / math.e, rel=1e-9)


def test_what_moves_both_peaks_alike_makes_no_kink() -> None:
    request = MetricRequest(metric="compliance_peak", source="u", target="y")
    ((_, gradient),) = measure(parallel(band_pass(0.01), band_pass(100.0), "++"), [request], gradient=["both"])
    assert gradient is not None
    assert not gradient.one_sided
    assert gradient.values == pytest.approx([1.0], abs=1e-3)

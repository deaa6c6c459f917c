"""One parameter set of a batch whose structure differs from the others': it gets what it would get alone, the others their numbers."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from engine.analysis.study import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import compile_system
from engine.model.document import Block, System
from engine.model.errors import DiagramError
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

STEP = {"u": make("step", {})}
RISE = MetricRequest(metric="rise_time", signals=STEP, output="y")
PEAK = MetricRequest(metric="peak", signals=STEP, output="y")
BANDWIDTH = MetricRequest(metric="bandwidth", source="u", target="y")
LAG = block("transfer_function", numerator=[1.0], denominator=[0.1, 1.0])


def before_a_lag(first: Block, *, delay: float = 0.0, **parameters: float) -> System:
    """u -> first -> 1/(0.1 s + 1) -> y; with a delay, by which a batch is marched and not compiled, in between."""
    line = {"line": block("delay", time=delay)} if delay else {}
    chain = ["u", "first", *line, "lag"]
    wires = [f"{a} -> {b}" for a, b in itertools.pairwise(chain)]
    return document({"u": block("input"), "first": first, **line, "lag": LAG}, wires, {"y": "lag"}, **parameters)


@pytest.mark.parametrize("delay", [0.0, 0.2])
def test_where_a_highest_power_vanishes_the_exact_path_decides_and_the_others_have_their_numbers(delay: float) -> None:
    # 1/((a s + 1)(0.1 s + 1)): of a = 0 the lag alone is left, which rises in ln 9 time constants
    lag = block("transfer_function", numerator=[1.0], denominator=["=a", 1.0])
    diagram = compile_system(before_a_lag(lag, delay=delay, a=0.5))
    found = Screening(diagram, [RISE])({"a": np.array([0.1, 0.0, 0.1, -np.inf, np.nan])})
    assert found.valid.tolist() == [True, True, True, False, False]
    assert found.doubtful[:3, 0].tolist() == [False, True, False]
    assert math.isnan(found.values[1, 0])
    # 1 - (1 + x) e^-x = 0.1 and 0.9 at these x
    assert found.values[[0, 2], 0] == pytest.approx((3.889720169867429 - 0.5318116083896343) * 0.1, rel=1e-7)
    ((alone, _),) = measure(diagram, [RISE], overrides={"a": 0.0})
    assert alone.value == pytest.approx(math.log(9.0) * 0.1, rel=1e-9)


@pytest.mark.parametrize("nominal", [0.0, 1.0])
def test_a_pair_of_poles_that_meets_on_the_axis_is_one_of_the_batch_where_it_does_not(nominal: float) -> None:
    # gain/((s + 1)^2 + w^2): overshoot exp(-pi/w), from a document whose pair has met as well as from one where it has not
    pair = block("zero_pole_gain", zeros=[], poles=[[-1.0, "=w"], [-1.0, "=-w"]], gain=1.0)
    diagram = compile_system(document({"u": block("input"), "g": pair}, ["u -> g"], {"y": "g"}, w=nominal))
    overshoot = MetricRequest(metric="overshoot", signals=STEP, output="y")
    found = Screening(diagram, [overshoot, BANDWIDTH])({"w": np.array([0.0, 1.0, 3.0])})
    assert found.doubtful.tolist() == [[True, True], [False, False], [False, False]]
    assert found.values[1:, 0] == pytest.approx([math.exp(-math.pi), math.exp(-math.pi / 3.0)], rel=1e-7)
    ((alone, _),) = measure(diagram, [overshoot], overrides={"w": 0.0})
    assert (alone.value, alone.verdict) == (0.0, Verdict.OK)


def test_a_pair_of_poles_that_falls_apart_is_no_system() -> None:
    pair = block("zero_pole_gain", zeros=[], poles=[["=a", 1.0], ["=b", -1.0]], gain=1.0)
    diagram = compile_system(before_a_lag(pair, a=-1.0, b=-1.0))
    found = Screening(diagram, [PEAK, BANDWIDTH])({"a": np.array([-1.0, -2.0])})
    assert found.doubtful.tolist() == [[False, False], [True, True]]
    with pytest.raises(DiagramError, match="must contain the conjugate of -2"):
        measure(diagram, [PEAK], overrides={"a": -2.0})


def test_a_coefficient_that_is_no_number_is_no_answer() -> None:
    gain = block("transfer_function", numerator=[1.0], denominator=["=a"])
    diagram = compile_system(before_a_lag(gain, a=1.0))
    found = Screening(diagram, [PEAK, BANDWIDTH])({"a": np.array([0.5, 0.0])})
    assert found.doubtful.tolist() == [[False, False], [True, True]]
    assert found.values[0, 0] == pytest.approx(2.0, rel=1e-9)
    with pytest.raises(DiagramError, match="denominator must have a coefficient other than 0"):
        measure(diagram, [PEAK], overrides={"a": 0.0})


@pytest.mark.parametrize("value", [1e101, -1e308])
def test_a_value_beyond_arithmetic_is_refused_in_a_batch_as_alone(value: float) -> None:
    diagram = compile_system(before_a_lag(block("gain", gain="=k"), k=1.0))
    found = Screening(diagram, [PEAK])({"k": np.array([2.0, value])})
    assert found.valid.tolist() == [True, False]
    assert found.values[0, 0] == pytest.approx(2.0, rel=1e-9)
    with pytest.raises(DiagramError, match=r"first\.gain must be <= 1e\+100 in size"):
        measure(diagram, [PEAK], overrides={"k": value})

"""Laws without memory beside samplers, held against difference equations by hand and against the exact path.

What sees what is held changes when the sampler does; what a sampler asks for counts when it samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram, compile_system
from engine.signals import make
from tests.reference.test_sampled_batches import STEP, held
from tests.unit.engine.diagrams import block, document

PERIOD, PARTS, DURATION = 0.01, 400, 0.6
LAWS: Mapping[str, tuple[Mapping[str, Any], Callable[[float], float]]] = {
    "saturation": ({"lower": -3.0, "upper": 2.0}, lambda v: min(max(v, -3.0), 2.0)),
    "dead_zone": ({"lower": -0.3, "upper": 0.2}, lambda v: v - min(max(v, -0.3), 0.2)),
    "quantizer": ({"step": 0.03}, lambda v: 0.03 * np.floor(v / 0.03 + 0.5)),
}
GAINS = (6.0, 9.0, 14.0)


@dataclass(frozen=True)
class Case:
    """Laws in front of the controller and behind it, from first to last; the controller's computing time."""

    before: tuple[str, ...] = ()
    behind: tuple[str, ...] = ()
    delay: float = 0.0
    given: Mapping[str, Any] = field(default_factory=dict)


CASES = {
    "saturation behind": Case(behind=("saturation",)),
    "saturation behind, computing": Case(behind=("saturation",), delay=0.004),
    "a whole period": Case(behind=("saturation",), delay=PERIOD),
    "two behind": Case(behind=("dead_zone", "saturation"), delay=0.004),
    "levels of the measurement": Case(before=("quantizer",)),
    "two before": Case(before=("dead_zone", "quantizer"), delay=0.004),
    "levels of both": Case(before=("quantizer",), behind=("quantizer", "saturation"), delay=0.004),
    "a controller with limits": Case(before=("quantizer",), behind=("dead_zone",), given={"lower": -4.0, "upper": 4.0}),
}


def loop(case: Case, *, hold: float | None = None) -> Diagram:
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"),
        "pid": block("sampled_pid", kp=9.0, ki=8.0, sample_time=PERIOD, delay=case.delay, **case.given),
        "plant": block("transfer_function", numerator=[1.0], denominator=[0.05, 1.0, 0.0]),
    }  # fmt: skip
    names = {"before": [], "behind": []}
    for place, own in names.items():
        for k, kind in enumerate(getattr(case, place)):
            own.append(f"{place}{k}")
            blocks[own[-1]] = block(kind, **LAWS[kind][0])
    if hold is not None:
        blocks["hold"] = block("zero_order_hold", sample_time=hold)
    slower = [] if hold is None else ["hold"]
    wires = ["r -> e.in1", "e -> pid"]
    wires += [f"{one} -> {other}" for one, other in pairwise(["plant", *names["before"], "e.in2"])]
    wires += [f"{one} -> {other}" for one, other in pairwise(["pid", *names["behind"], *slower, "plant"])]
    return compile_system(document(blocks, wires, {"y": "plant", "u": (["pid", *names["behind"]])[-1]}))


def by_hand(case: Case, kp: float, ki: float = 8.0, slower: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return the output and what drives the plant; held once more for ``slower`` periods, what there was before the sample."""
    phi, gamma = held(PERIOD / PARTS)
    x, integral, wanted, driving = np.zeros(2), 0.0, 0.0, 0.0
    lower, upper = case.given.get("lower", -np.inf), case.given.get("upper", np.inf)
    at = round(case.delay / PERIOD * PARTS)
    outputs, efforts = [], []
    for k in range(round(DURATION / PERIOD)):
        if slower and k % slower == 0:
            driving = through(case.behind, wanted)
        if at == PARTS:  # what comes after a whole period comes before the next sample
            driving = through(case.behind, wanted)
        error, before = 1.0 - through(case.before, float(x[0])), integral
        integral += ki * PERIOD * error
        asked = kp * error + integral
        wanted = min(max(asked, lower), upper)
        if (asked - wanted) * (integral - before) > 0:
            integral = before
        for part in range(PARTS):
            driving = through(case.behind, wanted) if part == at and not slower else driving
            outputs.append(x[0])
            efforts.append(driving)
            x = phi @ x + gamma * driving
    return np.array([*outputs, x[0]]), np.array([*efforts, driving])


def through(kinds: tuple[str, ...], value: float) -> float:
    for kind in kinds:
        value = LAWS[kind][1](value)
    return value


@pytest.mark.parametrize("name", CASES)
def test_responses_by_difference_equations(name: str) -> None:
    case = CASES[name]
    asked = [
        MetricRequest(metric=metric, signals=STEP, output=output, duration=DURATION)
        for metric, output in (("peak", "y"), ("ise", "y"), ("iae", "y"), ("peak", "u"))
    ]
    found = Screening(loop(case), asked, threads=1)({"pid.kp": np.array(GAINS)})
    assert not found.doubtful.any()
    for row, kp in enumerate(GAINS):
        y, u = by_hand(case, kp)
        width = PERIOD / PARTS
        integrals = [np.trapezoid((1 - y) ** 2, dx=width), np.trapezoid(np.abs(1 - y), dx=width)]
        np.testing.assert_allclose(found.values[row], [np.abs(y).max(), *integrals, np.abs(u).max()], rtol=3e-6)


@pytest.mark.parametrize(
    "name", ["saturation behind, computing", "levels of the measurement", "a controller with limits"]
)
def test_the_exact_path_has_the_same_numbers(name: str) -> None:
    diagram = loop(CASES[name])
    metrics = ("peak", "rise_time", "iae", "itae", "ie", "max_velocity", "overshoot", "settling_time")
    asked = [MetricRequest(metric=metric, signals=STEP, output="y", duration=0.3) for metric in metrics]
    found = Screening(diagram, asked, threads=1)({"pid.kp": np.array(GAINS[:1])})
    exact = measure(diagram, asked, overrides={"pid.kp": GAINS[0]})
    assert (~found.doubtful[0]).sum() >= 4
    for value, (measured, _), doubtful in zip(found.values[0], exact, found.doubtful[0], strict=True):
        if not doubtful and measured.value is None:
            assert not np.isfinite(value)
        elif not doubtful:
            assert value == pytest.approx(measured.value, rel=1e-9, abs=1e-11)


def test_two_rates() -> None:
    """What follows a limit is held once more, by half the rate: the slower one samples first, from the first instant on."""
    case = Case(before=("quantizer",), behind=("saturation",))
    diagram = loop(case, hold=2 * PERIOD)
    asked = [MetricRequest(metric=metric, signals=STEP, output="y", duration=0.3) for metric in ("peak", "iae")]
    found = Screening(diagram, asked, threads=1)({"pid.kp": np.array(GAINS[:1])})
    exact = measure(diagram, asked, overrides={"pid.kp": GAINS[0]})
    np.testing.assert_allclose(found.values[0], [measured.value for measured, _ in exact], rtol=1e-9)
    y, _ = by_hand(case, GAINS[0], slower=2)
    y = y[: round(0.3 / PERIOD) * PARTS + 1]
    expected = [np.abs(y).max(), np.trapezoid(np.abs(1 - y), dx=PERIOD / PARTS)]
    np.testing.assert_allclose(found.values[0], expected, rtol=3e-6)


def test_slopes_by_limits() -> None:
    case = CASES["saturation behind, computing"]
    names = ("pid.kp", "behind0.upper")
    at = {"pid.kp": 9.0, "behind0.upper": 2.0}
    lanes = {name: np.array([at[name] + 1e-30j * (name == other) for other in names]) for name in names}
    asked = [MetricRequest(metric=metric, signals=STEP, output="y", duration=0.3) for metric in ("ise", "itae")]
    found = Screening(loop(case), asked, threads=1)(lanes)
    exact = measure(loop(case), asked, overrides=at, gradient=list(at))
    assert not found.doubtful.any()
    for lane in range(2):
        slopes = [slope.values[lane] for _, slope in exact]
        np.testing.assert_allclose(found.values[lane].imag / 1e-30, slopes, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("kind", LAWS)
def test_a_law_that_acts_between_samples_is_left_to_the_exact_path(kind: str) -> None:
    """It sees the plant and acts on it: nothing holds it."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "f": block(kind, **LAWS[kind][0]),
        "pid": block("sampled_pid", kp=9.0, sample_time=PERIOD), "force": block("sum", signs="+-"),
        "plant": block("transfer_function", numerator=[1.0], denominator=[0.05, 1.0, 0.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "plant -> e.in2", "e -> pid", "pid -> force.in1", "plant -> f", "f -> force.in2"]
    wires.append("force -> plant")
    diagram = compile_system(document(blocks, wires, {"y": "plant"}))
    asked = [MetricRequest(metric="peak", signals={"r": make("step", {})}, output="y", duration=0.2)]
    assert Screening(diagram, asked)({"pid.kp": np.array([9.0])}).doubtful.all()


def test_a_measurement_in_levels_that_is_looked_at_is_followed_by_the_exact_path() -> None:
    diagram = loop(CASES["levels of the measurement"])
    seen = compile_system(
        diagram.system.__class__(**{**vars(diagram.system), "outputs": {"y": "plant", "m": "before0"}})
    )
    asked = [MetricRequest(metric="iae", signals=STEP, output="m", duration=0.2)]
    assert Screening(seen, asked)({"pid.kp": np.array([9.0])}).doubtful.all()

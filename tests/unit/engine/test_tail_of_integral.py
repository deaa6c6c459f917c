"""Whether an integral of all time has come to its end: exponentials have, powers of time have not, and a hunting loop is one of the latter."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.study import MetricRequest, measure
from engine.diagram.diagram import Diagram, compile_system
from engine.exact.time.tail_of_integral import has_ended
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

TIMES = np.linspace(0.0, 1000.0, 100_001)
INTEGRALS = ("iae", "itae")


def ended(sizes: np.ndarray, since: float = 0.0) -> bool:
    return bool(has_ended(TIMES, sizes[:, None], since, lambda e, _: np.abs(e))[0])


@pytest.mark.parametrize("power", [0.5, 1, 2, 3])
def test_powers_of_time_leave_something(power):
    assert not ended((1 + TIMES) ** -power)


@pytest.mark.parametrize(("lifetimes", "enough"), [(2, False), (5, False), (14, True), (40, True)])
def test_exponentials_end_when_little_is_left(lifetimes, enough):
    assert ended(np.exp(-TIMES * lifetimes / 1000.0)) is enough


def test_a_small_slow_part_counts_by_what_it_brings():
    """e^(-t) and a thousandth that takes 500 s: half of its integral, a quarter of all, is still to come; of 1e-9 nobody would see it."""
    fast, slow = np.exp(-TIMES), np.exp(-TIMES / 500.0)
    assert not ended(fast + 1e-3 * slow)
    assert ended(fast + 1e-9 * slow)


def test_what_stands_still_a_little_off_goes_on():
    assert not ended(np.where(TIMES < 400.0, 1.0, 1e-5))
    assert ended(np.where(TIMES < 400.0, 1.0, 1e-7))


def test_what_a_run_leaves_of_nothing_does_not_count():
    assert bool(has_ended(TIMES, np.where(TIMES < 1.0, 1.0, 5e-10)[:, None], 0.0, lambda e, t: t * np.abs(e))[0])


def test_the_time_counts_from_the_last_change():
    sizes = np.exp(-np.maximum(TIMES - 900.0, 0.0))
    assert not ended(sizes)
    assert ended(sizes, 900.0)


def loop(kp: float, integral_time: float, lag: float, width: float) -> Diagram:
    """Return a position loop with PI control whose drive does not answer to small commands."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"),
        "pi": block("pid", kp=kp, integral_time=integral_time, kd=0.0, filter_frequency=1000.0),
        "zone": block("dead_zone", lower=-width, upper=width),
        "drive": block("transfer_function", numerator=[1.0], denominator=[lag, 1.0, 0.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "drive -> e.in2", "e -> pi", "pi -> zone", "zone -> drive"]
    return compile_system(document(blocks, wires, {"y": "drive"}))


def integrals(diagram: Diagram, duration: float | None = None):
    signals = {"r": make("step", {"amplitude": 1.0})}
    asked = [MetricRequest(metric=name, signals=signals, output="y", duration=duration) for name in INTEGRALS]
    return [found for found, _ in measure(diagram, asked)]


@pytest.mark.parametrize("numbers", [(0.414, 1.796, 0.198, 0.022), (0.573, 4.301, 0.387, 0.194)])
def test_a_loop_that_hunts_for_ever_has_no_integral_of_all_time(numbers):
    """Its steps become smaller as 1/t, and last as long as t: the integral of the error grows with the logarithm of the time, or with it."""
    diagram = loop(*numbers)
    for found in integrals(diagram):
        assert found.verdict is Verdict.NOT_SETTLED
        assert "give a duration" in found.advice
    once, twice = integrals(diagram, 500.0), integrals(diagram, 1000.0)
    assert twice[1].value > 1.3 * once[1].value


@pytest.mark.parametrize(
    ("numbers", "rests"), [((2.7744, 5.797, 0.595, 0.261), 700.0), ((4.117, 6.626, 0.078, 0.0779), 200.0)]
)
def test_a_loop_that_hunts_once_more_is_followed_until_it_has(numbers, rests):
    diagram = loop(*numbers)
    for free, long in zip(integrals(diagram), integrals(diagram, 2 * rests), strict=True):
        assert free.value == pytest.approx(long.value, rel=1e-5)

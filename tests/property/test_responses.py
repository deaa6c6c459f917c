"""Curves against partial fractions, and the two laws of linear systems: superposition and time invariance.

Tolerance: 1e-11 of the largest value of the curve, and the rounding of the exact sum itself, whose terms cancel while the
response is still small.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.analysis.study import simulate
from engine.signals import make
from tests.property.strategies import Plant, plants
from tests.reference import mpmath_oracle as oracle
from tests.reference.systems import block, system, transfer_function


def rational(plant: Plant) -> oracle.Rational:
    numerator, denominator = plant.polynomials()
    return oracle.Rational(oracle.poly(*numerator), oracle.poly(*denominator))


def curve(plant: Plant, signal: Any, duration: float) -> tuple[np.ndarray, np.ndarray]:
    diagram = transfer_function(*plant.polynomials())
    done = simulate(diagram, signals={"u": signal}, duration=duration, samples=101, metrics=[])
    return done.time, done.curves["y"]


def assert_close(got: np.ndarray, exact: oracle.ExponentialSum, t: np.ndarray) -> None:
    values = exact.on_grid(t)
    rounding = 1e-14 * sum(abs(complex(c)) for c, _ in exact.terms)
    assert np.abs(got - values).max() <= 1e-11 * np.abs(values).max() + rounding


@given(plants(), st.floats(0.1, 20.0))
def test_step(plant: Plant, duration: float) -> None:
    t, y = curve(plant, make("step", {}), duration)
    assert_close(y, oracle.ExponentialSum.step_response(rational(plant)), t)


@given(plants(), st.floats(0.1, 20.0))
def test_ramp_is_the_integral_of_the_step(plant: Plant, duration: float) -> None:
    t, y = curve(plant, make("ramp", {"slope": 1.0}), duration)
    assert_close(y, oracle.ExponentialSum.step_response(rational(plant)).integral(), t)


@given(plants(), st.floats(0.5, 30.0), st.floats(0.1, 20.0))
def test_sine(plant: Plant, frequency: float, duration: float) -> None:
    t, y = curve(plant, make("sine", {"frequency": frequency}), duration)
    g, w = rational(plant), oracle.mp.mpf(frequency)
    command = oracle.Rational(
        oracle.multiply(g.num, [w]), oracle.multiply(g.den, [oracle.mp.mpf(1), oracle.mp.mpf(0), w**2])
    )
    assert_close(y, oracle.ExponentialSum.inverse_laplace(command), t)


@given(plants(), st.floats(0.01, 3.0))
def test_time_invariance(plant: Plant, start: float) -> None:
    t, early = curve(plant, make("step", {}), 5.0)
    late = simulate(
        transfer_function(*plant.polynomials()),
        signals={"u": make("step", {"start": start})},
        duration=5.0 + start,
        samples=101,
        metrics=[],
    )
    exact = oracle.ExponentialSum.step_response(rational(plant))
    assert_close(early, exact, t)
    before = late.time < start
    assert not late.curves["y"][before].any()
    assert_close(late.curves["y"][~before], exact, late.time[~before] - start)


@given(plants(), plants(), st.floats(-3, 3).filter(lambda a: a == 0 or abs(a) >= 1e-100), st.floats(0.5, 30.0))
def test_superposition(first: Plant, second: Plant, amplitude: float, frequency: float) -> None:
    both = system(
        {
            "u": block("input"),
            "v": block("input"),
            "first": block("transfer_function", numerator=first.polynomials()[0], denominator=first.polynomials()[1]),
            "second": block(
                "transfer_function", numerator=second.polynomials()[0], denominator=second.polynomials()[1]
            ),
            "sum": block("sum", signs="+-"),
        },
        ["u -> first", "v -> second", "first -> sum.in1", "second -> sum.in2"],
        {"y": "sum"},
    )
    signals = {"u": make("step", {"amplitude": amplitude}), "v": make("sine", {"frequency": frequency})}
    together = simulate(both, signals=signals, duration=4.0, samples=101, metrics=[]).curves["y"]
    alone = [
        simulate(both, signals={port: s}, duration=4.0, samples=101, metrics=[]).curves["y"]
        for port, s in signals.items()
    ]
    scale = max(np.abs(alone[0]).max(), np.abs(alone[1]).max())
    assert together == pytest.approx(alone[0] + alone[1], rel=0, abs=1e-11 * scale)

"""Frequency responses of lags with known corner, known noise."""

from __future__ import annotations

import numpy as np
import pytest

from engine.recordings.validation.comparison import Comparison
from engine.recordings.validation.spectrum import by_input, frequency_domain
from tests.unit.engine.validation.lags import H, lag

RNG = np.random.default_rng(11)
U = RNG.normal(size=16_384)


def compared(measured: np.ndarray, simulated: np.ndarray, **inputs: np.ndarray) -> Comparison:
    return Comparison(name="y", measured=measured, simulated=simulated, sample_time=H, inputs=inputs or {"u": U})


def held(frequency: np.ndarray, tau: float) -> np.ndarray:
    """Return the response of y[n] = a y[n - 1] + (1 - a) u[n - 1] at z = exp(jωh)."""
    a, z = np.exp(-H / tau), np.exp(1j * frequency * H)
    return (1 - a) / (z - a)


def test_both_responses_are_those_of_their_formulas() -> None:
    found = frequency_domain(compared(lag(U, tau=0.005), lag(U, tau=0.004)))
    assert found is not None
    slow = found.measured.frequency < 300.0
    frequency = found.measured.frequency[slow]
    # a lag that dies within 40 of the 2048 samples of a segment: what leaks is a percent
    assert np.abs(found.measured.value[slow] / held(frequency, 0.005) - 1).max() < 0.05
    assert np.abs(found.simulated[slow] / held(frequency, 0.004) - 1).max() < 0.05
    expected = 20 * np.log10(np.abs(held(frequency, 0.004) / held(frequency, 0.005)))
    assert found.comparison.deviation[slow] == pytest.approx(expected, abs=0.3)


def test_the_true_model_lies_within_the_bounds_and_another_one_does_not() -> None:
    noise = 0.05 * np.random.default_rng(12).normal(size=U.size)
    true = frequency_domain(compared(lag(U, tau=0.005) + noise, lag(U, tau=0.005)))
    wrong = frequency_domain(compared(lag(U, tau=0.005) + noise, 1.3 * lag(U, tau=0.005)))
    assert true is not None
    assert wrong is not None
    assert true.comparison.within_percent is not None
    assert wrong.comparison.within_percent is not None
    assert true.comparison.within_percent > 85
    assert wrong.comparison.within_percent < 0.5 * true.comparison.within_percent
    assert wrong.comparison.relative_error_percent == pytest.approx(30, abs=2)


def test_what_no_linear_model_explains_is_the_noise() -> None:
    y = lag(U, tau=0.005)
    noise = np.random.default_rng(13).normal(size=U.size)
    noise *= 0.3 * y.std() / noise.std()
    found = frequency_domain(compared(y + noise, y))
    assert found is not None
    # 0.3 of y beside sqrt(1 + 0.09) of it
    assert found.unexplained_percent == pytest.approx(100 * 0.3 / np.sqrt(1.09), rel=0.1)


def test_lines_without_an_input_are_left_out() -> None:
    """A chirp to 8 Hz: nothing is known at 100 Hz, however coherent its noise looks."""
    time = H * np.arange(16_384)
    slow = np.sin(2 * np.pi * (0.2 * time + 0.25 * time**2))
    y = lag(slow) + 1e-4 * np.random.default_rng(14).normal(size=time.size)
    found = frequency_domain(compared(y, lag(slow), u=slow))
    assert found is not None
    assert found.measured.frequency.max() < 2 * np.pi * 30
    assert found.lines > 900


@pytest.mark.parametrize(
    "case",
    [
        compared(U, U, u=U, v=U),
        compared(U[:200], U[:200], u=U[:200]),
        compared(np.full(2000, 3.0), U[:2000], u=U[:2000]),
        compared(U[:2000], np.zeros(2000), u=U[:2000]),
        compared(U[:2000], U[:2000], u=np.ones(2000)),
    ],
)
def test_there_is_no_comparison_where_it_would_say_nothing(case) -> None:
    assert frequency_domain(case) is None


def test_each_of_several_inputs_is_compared_without_the_others() -> None:
    """Two noises with a common part; the second one's response is wrong in the model, the first one's right."""
    rng = np.random.default_rng(21)
    first = U
    second = 0.6 * U + rng.normal(size=U.size)
    noise = 0.05 * rng.normal(size=U.size)
    measured = lag(first, tau=0.005) + 0.5 * lag(second, tau=0.003) + noise
    simulated = lag(first, tau=0.005) + 0.4 * lag(second, tau=0.003)
    comparison = compared(measured, simulated, a=first, b=second)
    found = by_input(comparison)
    assert set(found) == {"a", "b"}
    assert frequency_domain(comparison) is None
    for name, gain, tau in (("a", 1.0, 0.005), ("b", 0.5, 0.003)):
        one = found[name]
        slow = one.measured.frequency < 300.0
        expected = gain * held(one.measured.frequency[slow], tau)
        assert np.median(np.abs(one.measured.value[slow] / expected - 1)) < 0.05
    assert found["a"].comparison.within_percent is not None
    assert found["a"].comparison.within_percent > 85
    # 0.4 instead of 0.5 is 1.94 dB
    assert found["b"].comparison.median_deviation == pytest.approx(1.94, abs=0.15)
    assert found["b"].unexplained_percent is None


def test_a_motion_and_its_velocity_are_not_told_apart() -> None:
    swing = lag(lag(U, tau=0.02), tau=0.02)
    found = by_input(compared(swing + 0.01 * U, swing, x=swing, v=3.0 * swing))
    assert found == {}
    assert by_input(compared(lag(U, tau=0.005), lag(U, tau=0.004))) == {}

"""A zero at 0 that cancels a pole at 0: the hidden mode integrates, and rounding must not make it unstable.

An inverted pendulum on a cart, θ/F = k s² / (s (s³ + a s² - b s - c)), under a PID controller with a filter of its derivative: both poles
at 0, that of the cart and that of the controller, are cancelled. What is left is told by the reduced polynomial alone,

    (s³ + a s² - b s - c) (τ s + 1) + k ((kp τ + kd) s² + (kp + ki τ) s + ki)
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.analysis.evaluation import Evaluation
from engine.analysis.study import simulate
from engine.diagram.diagram import Diagram
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.reference.systems import block, system

KP, KI, KD, FILTER = 100.0, 1.0, 20.0, 1000.0


def coefficients(cart: float, pendulum: float, length: float, friction: float) -> tuple[float, list[float]]:
    """Return k and [1, a, -b, -c]."""
    inertia, g = 0.333 * pendulum * length**2, 9.8
    q = (cart + pendulum) * (inertia + pendulum * length**2) - (pendulum * length) ** 2
    drop = pendulum * g * length / q
    row = [1.0, friction * (inertia + pendulum * length**2) / q, -(cart + pendulum) * drop, -friction * drop]
    return pendulum * length / q, row


def loop(k: float, row: list[float]) -> Diagram:
    return system(
        {
            "r": block("input"),
            "error": block("sum", signs="+-"),
            "controller": block("pid", kp=KP, ki=KI, kd=KD, filter_frequency=FILTER),
            "plant": block("transfer_function", numerator=[k, 0.0, 0.0], denominator=[*row, 0.0]),
        },
        ["r -> error.in1", "plant -> error.in2", "error -> controller", "controller -> plant"],
        {"angle": "plant", "control": "controller"},
    )


def reduced(k: float, row: list[float]) -> np.ndarray:
    tau = 1 / FILTER
    own = np.polymul(row, [tau, 1.0])
    return np.roots(np.polyadd(own, k * np.array([KP * tau + KD, KP + KI * tau, KI])))


def cases() -> list[tuple[float, float, float, float]]:
    rng = np.random.default_rng(14)
    sizes = np.array([0.5, 0.2, 0.3, 0.1]) * 10 ** rng.uniform(-0.5, 0.5, (25, 4))
    return [(0.5, 0.2, 0.3, 0.1), *(tuple(row) for row in sizes.tolist())]


@pytest.mark.parametrize("case", cases())
def test_what_is_cancelled_at_rest_is_not_unstable(case: tuple[float, float, float, float]) -> None:
    k, row = coefficients(*case)
    left = reduced(k, row)
    poles = Evaluation(loop(k, row)).poles
    assert int(poles.at_zero.sum()) == 2
    assert np.sort(poles.values[~poles.at_zero].real) == pytest.approx(np.sort(left.real), rel=1e-8)
    assert poles.verdict is (Verdict.UNSTABLE if left.real.max() > 0 else Verdict.INTEGRATING)


def test_a_step_of_a_pendulum_is_followed() -> None:
    k, row = coefficients(0.5, 0.2, 0.3, 0.1)
    assert reduced(k, row).real.max() < 0
    final = KI * k / row[-1]
    final /= 1 + final  # L(0) / (1 + L(0))
    slowest = np.abs(reduced(k, row)).min()
    done = simulate(loop(k, row), signals={"r": make("step", {})}, duration=5.0, samples=11)
    assert done.verdict is Verdict.INTEGRATING
    assert done.time[-1] == 5.0
    metrics = done.metrics["angle"]
    assert metrics["steady_state_error"].value == pytest.approx(1 - final, rel=1e-9)
    # beside a mode of an hour and more the others are nothing
    assert metrics["rise_time"].value == pytest.approx(math.log(9) / slowest, rel=1e-2)
    assert done.metrics["control"]["rise_time"].verdict is Verdict.INTEGRATING

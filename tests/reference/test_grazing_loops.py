"""Loops that only just touch: a gain that turns at 1, a phase that turns at -180°, a curve that passes -1 by one part in 1e6.

    |k/(s² + 2ζs + 1) e^{-sτ}| = 1:  (1 - x)² + 4ζ²x = k²;     k/(s⁵ + e₄s⁴ + 2s³ + e₂s² + cs + e₀):  x² - 2x + c = 0;     x = ω²
    -k e^{-sτ}/(s + b) = 1:  ωτ + atan(ω/b) = π(1 + 2j);  one pair of poles more is unstable for each gain that is passed

Expected values are these formulas at 60 digits; crossings that are δ from touching are known to rounding over √δ.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import settings

from engine.analysis.study import MetricRequest, frequency_response, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from engine.model.verdicts import Verdict
from tests.reference.systems import block, system

mp = mpmath.mp.clone()
mp.dps = 60

LOOPS = 60 if settings().max_examples > 1000 else 3
AWAY = [1e-3, -1e-3, 1e-6, -1e-6, 1e-9, -1e-9]


def loop(delay: float, numerator: list[float], denominator: list[float]) -> Diagram:
    plant = block("transfer_function", numerator=numerator, denominator=denominator)
    wires = ["r -> e.in1", "plant -> e.in2", "e -> late", "late -> plant"]
    blocks = {"r": block("input"), "e": block("sum", signs="+-"), "late": block("delay", time=delay), "plant": plant}
    return system(blocks, wires, {"y": "plant"})


def listed(diagram: Diagram) -> Any:
    margins = frequency_response(diagram, open_at="e", metrics=[]).margins
    assert margins is not None
    return margins


@pytest.mark.parametrize("away", AWAY)
def test_a_gain_that_turns_at_one_behind_a_delay(away: float) -> None:
    generator = np.random.default_rng(3)
    for _ in range(LOOPS):
        damping, delay = float(10 ** generator.uniform(-3, -0.4)), float(10 ** generator.uniform(-2, 1))
        twice = mp.mpf(2 * damping)
        gain = float(twice * mp.sqrt(1 - twice**2 / 4) * (1 + mp.mpf(away)))
        apart = (2 - twice**2) ** 2 - 4 * (1 - mp.mpf(gain) ** 2)
        found = sorted(listed(loop(delay, [gain], [1.0, 2 * damping, 1.0])).phase)
        assert len(found) == (2 if apart > 0 and gain < 1 else 0)
        for side, (frequency, margin) in zip((-1, 1), found, strict=False):
            x = (2 - twice**2 + side * mp.sqrt(apart)) / 2
            omega = mp.sqrt(x)
            phase = mp.pi - mp.arg(1 - x + mp.mpc(0, 1) * twice * omega) - omega * mp.mpf(delay)
            close = max(1e-9, 1e-14 / np.sqrt(abs(away)) / damping)
            assert frequency == pytest.approx(float(omega), rel=close)
            turned = (float(phase) - margin + np.pi) % (2 * np.pi) - np.pi
            assert abs(turned) <= close * (1 / damping + delay)


@pytest.mark.parametrize("away", AWAY)
def test_a_phase_that_turns_at_half_a_turn(away: float) -> None:
    generator = np.random.default_rng(4)
    for _ in range(LOOPS):
        fourth, second, last = (float(v) for v in generator.uniform(0.3, 3, 3))
        gain, first = float(10 ** generator.uniform(-2, 0.5)), float(1 - mp.mpf(away))
        found = sorted(
            pair for pair in listed(loop_at_once(gain, [1.0, fourth, 2.0, second, first, last])).gain if pair[0]
        )
        apart = 1 - mp.mpf(first)
        exact = [1 + side * mp.sqrt(apart) for side in (-1, 1)] if apart > 0 else []
        values = [
            (mp.sqrt(x), -(mp.mpf(fourth) * x**2 - mp.mpf(second) * x + mp.mpf(last)) / mp.mpf(gain)) for x in exact
        ]
        expected = [(float(w), float(m)) for w, m in values if 0 < m < 1000]
        close = max(1e-9, 1e-14 / np.sqrt(abs(away)))
        assert len(found) == len(expected)
        for pair, wanted in zip(found, expected, strict=True):
            assert pair == pytest.approx(wanted, rel=close)


def loop_at_once(gain: float, denominator: list[float]) -> Diagram:
    plant = block("transfer_function", numerator=[gain], denominator=denominator)
    wires = ["r -> e.in1", "plant -> e.in2", "e -> plant"]
    return system({"r": block("input"), "e": block("sum", signs="+-"), "plant": plant}, wires, {"y": "plant"})


@pytest.mark.parametrize("beyond", [1e-6, -1e-6, 1e-8, -1e-8])
@pytest.mark.parametrize("turn", [0, 2])
def test_a_curve_that_passes_the_point_by_a_millionth(turn: int, beyond: float) -> None:
    generator = np.random.default_rng(5)
    for _ in range(LOOPS):
        pole, delay = (float(10 ** generator.uniform(-1, 1)) for _ in range(2))
        angle = mp.pi * (1 + 2 * turn)
        omega = mp.findroot(lambda w: w * mp.mpf(delay) + mp.atan(w / mp.mpf(pole)) - angle, (angle - 1.2) / delay)  # noqa: B023 -- solved at once
        gain = float(mp.sqrt(omega**2 + mp.mpf(pole) ** 2) * (1 + mp.mpf(beyond)))
        study = frequency_response(loop(delay, [gain], [1.0, pole]), open_at="e", metrics=[])
        unstable = 2 * turn + (2 if beyond > 0 else 0)
        assert study.nyquist is not None
        assert study.nyquist.closed_loop == unstable
        assert study.verdict is (Verdict.UNSTABLE if unstable else Verdict.OK)


@pytest.mark.parametrize("metric", ["delay_margin", "phase_margin", "gain_margin"])
def test_many_candidates_whose_resonance_just_passes_or_does_not(metric: str) -> None:
    """A slow pole and a resonance behind a delay: from 1e-6 to 0.03 beside a gain of 1, where the margin jumps."""
    generator = np.random.default_rng(5)
    compared = 0
    for _ in range(4):
        damping, delay = float(10 ** generator.uniform(-2.5, -1.3)), float(generator.uniform(0.05, 0.6))
        denominator = [1.0, 2 * damping + 0.05, 1.0 + 0.1 * damping, 0.05]  # (s² + 2ζs + 1)(s + 0.05)
        blocks = {
            "r": block("input"), "e": block("sum", signs="+-"), "k": block("gain", gain=1.0), "late": block("delay", time=delay),
            "plant": block("transfer_function", numerator=[1.0], denominator=denominator),
        }  # fmt: skip
        wires = ["r -> e.in1", "plant -> e.in2", "e -> k", "k -> late", "late -> plant"]
        diagram = system(blocks, wires, {"y": "plant"})
        omega = np.linspace(0.9, 1.1, 200_001)
        highest = 1.0 / np.abs(np.polyval(denominator, 1j * omega)).min()
        away = 10 ** generator.uniform(-6, -1.5, 30) * generator.choice([-1, 1], 30)
        gains = (1 + away) / highest
        request = MetricRequest(metric=metric, open_at="e")
        found = Screening(diagram, [request])({"k.gain": gains})
        for k in np.flatnonzero((found.growth < 0) & ~found.doubtful[:, 0]):
            (exact, _), = measure(diagram, [request], overrides={"k.gain": float(gains[k])})  # fmt: skip
            assert found.values[k, 0] == pytest.approx(np.inf if exact.value is None else exact.value, rel=1e-6), away[
                k
            ]
            compared += 1
    assert compared > 60

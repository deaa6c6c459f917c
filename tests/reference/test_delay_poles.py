"""Stability of loops with one delay where it is hard to see: gains of a million, resonances far above the delay's own pace.

A pole s of 1 + e^{-sτ} G(s) is checked at 40 digits; the count of unstable ones is that of the argument principle, taken on
a plain grid of frequencies, and of Lambert's W where G = k/(s + 1):  s + 1 = W_j(-k τ e^τ) / τ.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from engine.analysis.study import frequency_response, simulate
from engine.diagram.diagram import Diagram
from engine.model.verdicts import Verdict
from tests.reference.measuring import step
from tests.reference.systems import block, system


def loop(delay: float, numerator: list[float], denominator: list[float]) -> Diagram:
    """r -> e -> e^{-s delay} num/den -> y, unity negative feedback."""
    plant = block("transfer_function", numerator=numerator, denominator=denominator)
    late = block("delay", time=delay)
    wires = ["r -> e.in1", "plant -> e.in2", "e -> late", "late -> plant"]
    return system(
        {"r": block("input"), "e": block("sum", signs="+-"), "late": late, "plant": plant}, wires, {"y": "plant"}
    )


@pytest.mark.parametrize(
    ("gain", "delay"), [(0.9, 1e3), (20.0, 1e3), (900.0, 1e3), (9e2, 1.0), (1e6, 1.0), (1e8, 1.0), (1e5, 1e2)]
)
def test_a_lag_behind_a_delay_at_any_gain(gain: float, delay: float) -> None:
    study = frequency_response(loop(delay, [gain], [1.0, 1.0]), open_at="e", metrics=[])
    with mpmath.workdps(40):
        z = -mpmath.mpf(gain) * delay * mpmath.exp(delay)
        rightmost = mpmath.lambertw(z, 0) / delay - 1
    first = study.poles[np.argmax(study.poles.real)]
    assert first.real == pytest.approx(float(rightmost.real), rel=1e-9)
    assert abs(first.imag) == pytest.approx(abs(float(rightmost.imag)), rel=1e-9)
    assert study.verdict is (Verdict.UNSTABLE if gain > 1 else Verdict.OK)


def unstable(gain: float, resonance: float, damping: float, delay: float) -> int:
    """Return how many poles are unstable: how far 1 + L(jω) turns clockwise, on 500,000 frequencies."""
    s = 1j * np.linspace(0.0, 3 * resonance, 500_000)
    closed = 1 + np.exp(-s * delay) * gain / ((s / resonance) ** 2 + 2 * damping * s / resonance + 1)
    return round(-float(np.unwrap(np.angle(closed))[-1]) / np.pi)


@pytest.mark.parametrize(
    ("gain", "resonance", "damping", "delay"),
    [
        (0.05, 30.0, 0.01, 1.0),
        (0.05, 300.0, 0.01, 1.0),
        (0.05, 1000.0, 0.01, 1.003),
        (0.019, 1000.0, 0.01, 1.0),
        (0.05, 1000.0, 0.001, 0.5),
        (0.05, 5000.0, 0.01, 1.0),
        (0.5, 1000.0, 0.01, 1.0),
    ],
)
def test_a_resonance_that_the_delay_turns_round_many_times(
    gain: float, resonance: float, damping: float, delay: float
) -> None:
    denominator = [1 / resonance**2, 2 * damping / resonance, 1.0]
    diagram = loop(delay, [gain], denominator)
    study = frequency_response(diagram, open_at="e", metrics=[])
    count = unstable(gain, resonance, damping, delay)
    assert study.verdict is (Verdict.UNSTABLE if count else Verdict.OK)
    if study.nyquist is not None:  # beyond some thousand radians of the delay's phase it is not counted
        assert study.nyquist.closed_loop == count
    with mpmath.workdps(40):
        for pole in study.poles[:6]:

            def residual(s: mpmath.mpc) -> mpmath.mpc:
                return mpmath.polyval(denominator[::-1], s, asc=True) * mpmath.exp(s * delay) + gain

            exact = mpmath.findroot(residual, mpmath.mpc(complex(pole)))
            assert abs(exact - complex(pole)) <= 1e-9 * abs(exact)


def test_an_instability_that_only_the_resonance_shows_is_no_metric() -> None:
    diagram = loop(1.0, [0.05], [1e-6, 2e-5, 1.0])
    found = simulate(diagram, signals={"r": step()}, outputs=["y"], duration=3.0, metrics=["settling_time", "peak"])
    assert found.verdict is Verdict.UNSTABLE
    assert found.metrics["y"]["settling_time"].verdict is Verdict.UNSTABLE


def test_crossings_that_are_too_many_to_list_are_cut_and_said() -> None:
    # 0.99 e^{-1000 s}/(s + 1) crosses the negative axis 157,000 times above |L| = 1e-3
    study = frequency_response(loop(1e3, [0.99], [1.0, 1.0]), open_at="e", metrics=[])
    assert study.margins is not None
    listed = np.array([frequency for frequency, _ in study.margins.gain])
    (remark,) = [remark.detail for remark in study.warnings if "listed up to" in remark.detail]
    last = float(remark.split("listed up to ")[1].split(" ")[0])
    # ω τ + atan ω = π (2k + 1): one in each turn of the delay, none left out
    turns = listed * 1e3 + np.arctan(listed)
    assert turns == pytest.approx(np.pi * (2 * np.arange(len(listed)) + 1), rel=1e-9)
    assert listed[-1] == pytest.approx(last, rel=3e-3)

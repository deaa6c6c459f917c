"""Loops whose gain rises above 1 by so little that both crossings lie between neighbours of any plain frequency grid.

L = k / (s² + 2 ζ s + 1):   |L| = 1 where (1 - x)² + 4 ζ² x = k², x = ω²
"""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screening import Screening
from tests.reference.systems import unity_loop

DAMPING = 0.1
SUMMIT = 2 * DAMPING * np.sqrt(1 - DAMPING**2)
METRICS = ("phase_margin", "delay_margin")


def margins(gain: float) -> tuple[float, float]:
    """Return the phase margin nearest to 0 (rad) and the delay margin (s), from the two roots of the quadratic."""
    x = np.roots([1.0, 4 * DAMPING**2 - 2.0, 1.0 - gain**2]).real
    omega = np.sqrt(x)
    phase = np.pi - np.arctan2(2 * DAMPING * omega, 1 - x)
    return float(phase[np.argmin(np.abs(phase))]), float(np.min(phase / omega))


@pytest.mark.parametrize("above", [1e-2, 1e-4, 1e-6, 1e-9])
def test_a_gain_that_hardly_rises_above_one_crosses_it_twice(above):
    gain = SUMMIT * (1 + above)
    loop = unity_loop(["=k"], [1.0, 2 * DAMPING, 1.0], k=gain)
    requests = [MetricRequest(metric=metric, open_at="error") for metric in METRICS]
    exact = [measured.value for measured, _ in measure(loop, requests)]
    assert exact == pytest.approx(margins(gain), rel=1e-9 if above > 1e-7 else 1e-6)  # the roots lose what they share
    screened = Screening(loop, requests)({"k": np.array([gain])})
    vouched = ~screened.doubtful[0]
    assert screened.values[0, vouched] == pytest.approx(np.array(exact)[vouched], rel=1e-7)


def test_a_gain_that_stays_below_one_crosses_nowhere():
    loop = unity_loop(["=k"], [1.0, 2 * DAMPING, 1.0], k=SUMMIT * (1 - 1e-6))
    measured, _ = measure(loop, [MetricRequest(metric="phase_margin", open_at="error")])[0]
    assert measured.value is None
    assert measured.verdict == "never_crosses"

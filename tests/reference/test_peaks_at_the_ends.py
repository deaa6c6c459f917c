"""Resonances so far from where the document's values put them that they lie beyond all samples of the frequency axis.

|T| = k / |(1 - x)² + 4 ζ² x|^½, x = (t ω)²:   its peak is k / (2 ζ √(1 - ζ²)), whatever t is
"""

from __future__ import annotations

import numpy as np
import pytest

from engine.measuring import MetricRequest
from engine.screening import Screening
from tests.reference.systems import transfer_function


def screened(damping: float, slower: float) -> tuple[float, bool]:
    """Return the peak of a candidate so much slower than the document's values, and whether it is in doubt."""
    system = transfer_function(["=k"], ["=t**2", "=2*z*t", 1.0], k=3.0, t=1.0, z=damping)
    request = MetricRequest(metric="compliance_peak", source="u", target="y")
    found = Screening(system, [request])({"t": np.array([slower]), "k": np.array([2.0])})
    return float(found.values[0, 0]), bool(found.doubtful[0, 0])


def peak(damping: float) -> float:
    return float(2.0 / (2 * damping * np.sqrt(1 - damping**2)))


@pytest.mark.parametrize("damping", [0.1, 0.5, 0.65, 0.7])
@pytest.mark.parametrize("slower", [0.1, 3.0, 8.0, 20.0, 100.0])
def test_a_peak_is_seen_wherever_its_frequency_is(damping, slower):
    value, doubtful = screened(damping, slower)
    assert not doubtful
    assert value == pytest.approx(peak(damping), rel=1e-9)


@pytest.mark.parametrize("damping", [0.1, 0.5, 0.65, 0.7])
@pytest.mark.parametrize("slower", [1e-3, 1e4])
def test_a_peak_beyond_all_tables_is_right_or_in_doubt(damping, slower):
    value, doubtful = screened(damping, slower)
    assert doubtful or value == pytest.approx(peak(damping), rel=1e-9)

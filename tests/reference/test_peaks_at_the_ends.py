"""Resonances so far from where the document's values put them that they lie beyond all samples of the frequency axis.

|T| = k / |(1 - x)² + 4 ζ² x|^½, x = (t ω)²:   its peak is k / (2 ζ √(1 - ζ²)), whatever t is
"""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest
from engine.batch.screening import Screening
from tests.reference.systems import transfer_function


def screened(damping: float, slower: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the peaks of candidates so much slower than the document's values, and whether they are in doubt."""
    system = transfer_function(["=k"], ["=t**2", "=2*z*t", 1.0], k=3.0, t=1.0, z=damping)
    request = MetricRequest(metric="compliance_peak", source="u", target="y")
    found = Screening(system, [request])({"t": slower, "k": np.full(len(slower), 2.0)})
    return found.values[:, 0], found.doubtful[:, 0]


def peak(damping: float) -> float:
    return float(2.0 / (2 * damping * np.sqrt(1 - damping**2)))


@pytest.mark.parametrize("damping", [0.1, 0.5, 0.65, 0.7])
def test_a_peak_is_seen_wherever_its_frequency_is(damping):
    values, doubtful = screened(damping, np.array([0.1, 3.0, 8.0, 20.0, 100.0]))
    assert not doubtful.any()
    assert values == pytest.approx(peak(damping), rel=1e-9)


@pytest.mark.parametrize("damping", [0.1, 0.5, 0.65, 0.7])
def test_a_peak_beyond_all_tables_is_right_or_in_doubt(damping):
    # powers of two and five: the first and the last sample of every table are among them
    slower = np.concatenate(
        [np.geomspace(1e-9, 1e9, 400), [2.0**i * 5.0**k for i in range(-20, 21) for k in range(-9, 10)]]
    )
    values, doubtful = screened(damping, slower)
    assert (doubtful | (abs(values / peak(damping) - 1.0) < 1e-9)).all()

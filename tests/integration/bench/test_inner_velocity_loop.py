"""The document of the batch job is the loop that it claims to be."""

from __future__ import annotations

import numpy as np
import pytest

from bench import inner_velocity_loop as inner
from engine.analysis.measuring import measure


def by_hand(kp: float, td1: float, td2: float, tf: float, kv: float) -> np.ndarray:
    """Return the characteristic polynomial from the block equations, multiplied out: 1 + C G H = 0, G with its velocity loop."""
    controller = np.array([kp * td2, kp * td1, kp]), np.array([tf**2, 2 * tf, 1.0])
    forward = np.array([90000.0 * 1600.0])
    inside = np.polyadd(np.polymul([1.0, 420.0, 90000.0], [1.0, 16.0, 1600.0]), kv * forward)
    plant = forward, np.polymul(inside, [1.0, 0.0])
    denominator = np.polymul(np.polymul(controller[1], plant[1]), [0.002, 1.0])
    return np.polyadd(denominator, np.polymul(controller[0], plant[0]))


@pytest.mark.parametrize("index", range(5))
def test_its_characteristic_polynomial_is_that_of_its_equations(index):
    candidates = {name: float(column[index]) for name, column in inner.wide(5, seed=2).items()}
    expected = by_hand(*candidates.values())
    found = np.poly(inner.diagram().realize(candidates).a)
    np.testing.assert_allclose(found, expected / expected[0], rtol=1e-9)


def test_its_metrics_are_those_computed_at_50_digits():
    found = measure(inner.diagram(), inner.requests())
    for request, (measured, _) in zip(inner.requests(), found, strict=True):
        assert measured.value == pytest.approx(inner.EXACT[request.metric], rel=1e-9, abs=1e-11), request.metric

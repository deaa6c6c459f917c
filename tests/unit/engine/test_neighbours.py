"""The numbers of a candidate are its own, to the bit, alone and among any others: followed, marched, scanned."""

from __future__ import annotations

import numpy as np
import pytest

from bench import coverage, coverage_laws
from engine import signals
from engine.analysis.measuring import MetricRequest
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram

COUNT = 20
STEP = {"reference": signals.make("step", {})}


def candidates() -> dict[str, np.ndarray]:
    """Return gains over decades: their loops have their corners, and so their frequencies, far from one another."""
    rng = np.random.default_rng(5)
    spread = {"pid.kp": (8.0, 1.6), "pid.ki": (2.0, 2.0), "pid.kd": (0.4, 1.5)}
    return {name: middle * 10 ** rng.uniform(-1.0, width - 1.0, COUNT) for name, (middle, width) in spread.items()}


def asked(diagram: Diagram, duration: float | None) -> list[MetricRequest]:
    timed = [
        MetricRequest(metric=name, signals=STEP, output="position", duration=duration)
        for name in ("overshoot", "itae", "settling_time")
    ]
    if diagram.sampled:
        return timed
    loop = [
        MetricRequest(metric=name, open_at="error")
        for name in ("phase_margin", "gain_margin", "delay_margin", "sensitivity_peak")
    ]
    path = [
        MetricRequest(metric=name, source="reference", target="position") for name in ("bandwidth", "resonance_peak")
    ]
    return [*timed, *loop, *path]


LAWS = [
    (kind, delay) for kind in ("saturation", "backlash", "friction", "rate_limiter", "relay") for delay in (0.0, 1e-3)
]


@pytest.mark.parametrize(
    ("diagram", "duration"),
    [
        pytest.param(coverage.diagram(1e-3), None, id="delay"),
        pytest.param(coverage_laws.loop("zero_order_hold", 1e-3), 1.0, id="zero_order_hold"),
        *(pytest.param(coverage_laws.loop(kind, delay), 1.0, id=f"{kind}-{delay}") for kind, delay in LAWS),
    ],
)
def test_a_number_is_the_same_to_the_bit_whoever_is_beside(diagram, duration) -> None:
    points, requests = candidates(), asked(diagram, duration)
    screening = Screening(diagram, requests)
    whole = screening(points)
    order = np.random.default_rng(1).permutation(COUNT)
    for pick in (order, order[:9], *(np.array([k]) for k in order[:5]), np.array([COUNT - 1, 3, 3, 17])):
        part = screening({name: column[pick] for name, column in points.items()})
        np.testing.assert_array_equal(part.doubtful, whole.doubtful[pick])
        known = ~part.doubtful
        np.testing.assert_array_equal(part.values[known], whole.values[pick][known])
        assert known.any() or diagram.nonlinear

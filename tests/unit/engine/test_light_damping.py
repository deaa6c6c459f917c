"""Modes that swing for days: what is asked of the first seconds is told, what looks at the end is not.

y(t) = 1 - e^(-z w t) (cos r t + z/sqrt(1 - z²) sin r t),   r = w sqrt(1 - z²)
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import simulate
from engine.diagram.diagram import Diagram, compile_system
from engine.model.errors import UnresolvedError
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

OMEGA, DURATION = 30.0, 3.0
STEP = {"r": make("step", {})}


def swinging(damping: float) -> Diagram:
    plant = block("transfer_function", numerator=[OMEGA**2], denominator=[1.0, 2 * damping * OMEGA, OMEGA**2])
    return compile_system(document({"r": block("input"), "plant": plant}, ["r -> plant"], {"y": "plant"}))


def answer(damping: float, time: np.ndarray) -> np.ndarray:
    root = np.sqrt(1 - damping**2)
    swing = np.cos(OMEGA * root * time) + damping / root * np.sin(OMEGA * root * time)
    return np.asarray(1 - np.exp(-damping * OMEGA * time) * swing)


@pytest.mark.parametrize("damping", [1e-8, 1e-6])
def test_metrics_of_a_duration(damping: float) -> None:
    asked = [
        MetricRequest(metric=metric, signals=STEP, output="y", duration=DURATION)
        for metric in ("peak", "ise", "rise_time")
    ]
    (peak, _), (ise, _), (rise, _) = measure(swinging(damping), asked)
    assert peak.value == pytest.approx(1 + np.exp(-np.pi * damping / np.sqrt(1 - damping**2)), rel=1e-11)
    squared, _ = quad(lambda t: (1 - answer(damping, np.array(t))) ** 2, 0.0, DURATION, limit=400, epsabs=1e-12)
    assert ise.value == pytest.approx(squared, rel=1e-9)
    assert rise.verdict is Verdict.NOT_SETTLED


def test_the_curve_of_a_duration() -> None:
    found = simulate(swinging(1e-7), signals=STEP, duration=DURATION, samples=301, metrics=["peak"])
    np.testing.assert_allclose(found.curves["y"], answer(1e-7, found.time), atol=1e-9)


def test_without_a_duration_it_is_refused() -> None:
    with pytest.raises(UnresolvedError, match="too lightly damped"):
        simulate(swinging(1e-7), signals=STEP, metrics=["peak"])

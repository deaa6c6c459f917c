"""The resonance peak of a path by its name: against the formula of a mode, and the same in the screening."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from tests.reference.systems import block, system

REQUEST = MetricRequest(metric="resonance_peak", source="r", target="y")


def mode() -> Diagram:
    blocks = {
        "r": block("input"),
        "mode": block("transfer_function", numerator=["=g*w**2"], denominator=[1, "=2*z*w", "=w**2"]),
    }
    return system(blocks, ["r -> mode"], {"y": "mode"}, {"g": 3.0, "w": 8.0, "z": 0.2})


def test_it_is_that_of_the_textbooks() -> None:
    # g / (2 z √(1 - z²)) at w √(1 - 2 z²);  d/dz = -peak (1 - 2 z²) / (z (1 - z²))
    ((found, gradient),) = measure(mode(), [REQUEST], gradient=["g", "w", "z"])
    peak = 3 / (0.4 * math.sqrt(0.96))
    assert found.value == pytest.approx(peak, rel=1e-12)
    assert found.at == pytest.approx(8 * math.sqrt(0.92), rel=1e-7)
    assert gradient is not None
    assert gradient.values == pytest.approx([peak / 3, 0.0, -peak * 0.92 / (0.2 * 0.96)], rel=1e-9, abs=1e-9)


def test_where_nothing_resonates_it_is_the_static_gain() -> None:
    ((found, _),) = measure(mode(), [REQUEST], overrides={"z": 0.8})
    assert (found.value, found.at) == (pytest.approx(3.0, rel=1e-12), 0.0)


def test_the_screening_finds_the_same() -> None:
    z = np.array([0.05, 0.2, 0.6])
    found = Screening(mode(), [REQUEST])({"z": z})
    assert not found.doubtful.any()
    assert found.values[:, 0] == pytest.approx(3 / (2 * z * np.sqrt(1 - z * z)), rel=1e-6)

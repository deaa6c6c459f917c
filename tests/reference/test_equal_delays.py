"""Slopes of responses by delays of which some are equal, against difference quotients: each moves alone, whatever meets where."""

from __future__ import annotations

import numpy as np
import pytest

from engine.exact.time.trajectory import respond
from engine.model.linear_system import LaneSystem, LinearSystem
from engine.model.tangent import INFINITESIMAL
from engine.signals import make

LATE = np.array([0.4137, 0.5311, 0.7713])
H = 1e-5


@pytest.mark.parametrize("seed", range(8))
def test_slopes_by_equal_delays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    m, n = int(rng.integers(2, 5)), int(rng.integers(1, 4))
    equal = rng.choice([0.07, 0.1, 0.2, 0.3], m)
    equal[1] = equal[0]
    equal[3:] = equal[2:3]
    parts = {
        "a": rng.normal(size=(n, n)) - 3 * np.eye(n), "b1": rng.normal(size=(n, 1)), "b2": rng.normal(size=(n, m)),
        "c1": rng.normal(size=(1, n)), "c2": rng.normal(size=(m, n)) * rng.integers(0, 2, (m, n)), "d11": np.zeros((1, 1)),
        "d12": np.zeros((1, m)), "d21": rng.normal(size=(m, 1)),
        "d22": 0.4 * rng.normal(size=(m, m)) * rng.integers(0, 2, (m, m)), "x0": np.zeros(n),
    }  # fmt: skip

    def at(delays: np.ndarray) -> LinearSystem:
        return LinearSystem(**parts, delays=delays, inputs=("r",), outputs=("y",))

    def read(*systems: LinearSystem) -> np.ndarray:
        curve = respond(LaneSystem.of(systems), [make("step", {})], 1.0).output(0)
        pieces = np.searchsorted(curve.times, LATE, side="right") - 1
        return np.array([curve.at(int(k), 0.0, float(t)) for k, t in zip(pieces, LATE, strict=True)])

    units = np.eye(m)
    found = read(*(at(equal + 1j * INFINITESIMAL * unit) for unit in units)).imag.T / INFINITESIMAL
    quotients = [(read(at(equal + H * unit)) - read(at(equal - H * unit)))[:, 0].real / (2 * H) for unit in units]
    assert found == pytest.approx(np.array(quotients), rel=1e-6, abs=1e-7)

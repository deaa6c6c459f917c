"""A mass that large forces hardly move: what counts as no velocity has nothing to do with how large the forces are."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.study import simulate
from engine.diagram.diagram import compile_system
from engine.signals import make
from tests.unit.engine.diagrams import block, document

MASS, FRICTION, PACE, EXCESS = 1e5, 1e6, 1e6, 1e-3
"""kg, N, N/s, and how long (s) before and after its top the force is beyond the friction."""


def test_a_slip_of_a_press_ends_where_its_momentum_does():
    """The excess s τ rises for T and falls again: the mass stops √2 T after it has gone, s T³/m (1 + 2√2/3) from where it was."""
    made = compile_system(
        document(
            {"u": block("input"), "f": block("friction", coulomb=FRICTION), "sum": block("sum", signs="+-"),
             "v": block("integrator", gain=1 / MASS), "x": block("integrator")},
            ["u -> sum.in1", "f -> sum.in2", "sum -> v", "v -> f", "v -> x"],
            {"v": "v", "x": "x"},
        )
    )  # fmt: skip
    top = FRICTION / PACE + EXCESS
    force = make("piecewise_linear", {"time": [0.0, top, 2 * top], "values": [0.0, PACE * top, 0.0]})
    found = simulate(made, signals={"u": force}, duration=1.2, samples=1201)
    largest = PACE * EXCESS**2 / MASS
    way = PACE * EXCESS**3 / MASS * (1 + 2 * np.sqrt(2) / 3)
    end = top + (1 + np.sqrt(2)) * EXCESS
    assert found.curves["v"].max() == pytest.approx(largest, rel=1e-6)
    assert np.all(found.curves["v"][found.time > end] == 0.0)
    assert found.curves["x"][-1] == pytest.approx(way, rel=1e-6)

"""Friction that builds up over a velocity: no stick phase, the curve itself, and the limit of the sticking one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.analysis.study import simulate
from engine.diagram.diagram import compile_system
from engine.signals import make
from tests.unit.engine.diagrams import block, document


def friction(**values: float):
    return compile_system(
        document({"v": block("input"), "k": block("friction", **values)}, ["v -> k.velocity"], {"force": "k"})
    )


def test_the_force_is_that_of_the_formula_in_both_directions():
    values = {"coulomb": 3.0, "static": 5.0, "stribeck_velocity": 0.2, "viscous": 0.7, "transition_velocity": 0.05}
    made = friction(**values, coulomb_negative=2.0, static_negative=2.5)
    found = simulate(made, signals={"v": make("sine", {"amplitude": 1.0, "frequency": 2.0})}, duration=4.0, samples=401)
    v = np.sin(2.0 * found.time)
    dry = np.where(v > 0, 3.0 + 2.0 * np.exp(-((v / 0.2) ** 2)), 2.0 + 0.5 * np.exp(-((v / 0.2) ** 2)))
    np.testing.assert_allclose(found.curves["force"], dry * np.tanh(v / 0.05) + 0.7 * v, atol=1e-9)


def test_its_slope_at_rest_is_what_is_linearised():
    made = friction(coulomb=3.0, static=5.0, stribeck_velocity=0.2, viscous=0.7, transition_velocity=0.05)
    assert made.realize().d11[0, 0] == pytest.approx(5.0 / 0.05 + 0.7, rel=1e-12)


def test_a_mass_under_a_small_force_creeps_instead_of_sticking():
    """F = F_c tanh(v/v_t) + b v: with F = F_c/2 and b = 0 the mass ends at v = v_t artanh(1/2)."""
    made = compile_system(
        document(
            {
                "f": block("input"), "net": block("sum", signs="+-"), "friction": block("friction", coulomb=4.0, transition_velocity=0.1),
                "mass": block("transfer_function", numerator=[1.0], denominator=[1.0, 0.0]),
            },
            ["f -> net.in1", "friction -> net.in2", "net -> mass", "mass -> friction"],
            {"v": "mass"},
        )
    )  # fmt: skip
    found = simulate(made, signals={"f": make("step", {"amplitude": 2.0})}, duration=5.0, samples=11)
    assert found.curves["v"][-1] == pytest.approx(0.1 * math.atanh(0.5), rel=1e-8)

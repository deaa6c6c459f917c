"""The pneumatic motor's undamped frequency sqrt((A^2 + a_m b_m) chi p / (V m)): its elasticities in closed form.

Seed paper, section 3, eq. (1)-(2) and (4): d ln w/d ln A = A^2/(A^2 + a_m b_m) = 0.99989, in V and m exactly -1/2; +40 % of V
changes it by 1.4^-1/2 - 1 = -15.5 %, hence C = -0.3871; +100 % of m by 2^-1/2 - 1 = -29.3 %, C = -0.2929.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.analysis.influence import influence
from engine.analysis.study import MetricRequest, frequency_response
from tests.reference.measuring import elasticities
from tests.reference.systems import MOTOR, block, system

LPM = system(
    {"flow": block("input"), "motor": block("linear_pneumatic_motor", **MOTOR)},
    ["flow -> motor.flow"],
    {"position": "motor.position", "velocity": "motor.velocity"},
)
REQUEST = MetricRequest(metric="critical_frequency")
STIFF, LEAK = MOTOR["area"] ** 2, MOTOR["leakage"] * MOTOR["viscous_friction"]
FREQUENCY = math.sqrt((STIFF + LEAK) * MOTOR["adiabatic_index"] * MOTOR["pressure"] / (MOTOR["volume"] * MOTOR["mass"]))


def test_both_transfer_functions_of_the_paper() -> None:
    # z/Q = A/(s [c m s^2 + (c b + m a) s + A^2 + a b]); z/F = -(c s + a)/(s [the same]), c = V/(chi p)
    motor = system(
        {"flow": block("input"), "force": block("input"), "motor": block("linear_pneumatic_motor", **MOTOR)},
        ["flow -> motor.flow", "force -> motor.force"],
        {"position": "motor.position"},
    )
    w = np.geomspace(0.1, 1e3, 41)
    s = 1j * w
    capacitance = MOTOR["volume"] / (MOTOR["adiabatic_index"] * MOTOR["pressure"])
    mass, friction, leakage = MOTOR["mass"], MOTOR["viscous_friction"], MOTOR["leakage"]
    bracket = capacitance * mass * s**2 + (capacitance * friction + mass * leakage) * s + STIFF + LEAK
    for source, numerator in (("flow", MOTOR["area"]), ("force", -(capacitance * s + leakage))):
        study = frequency_response(motor, source=source, target="position", frequencies=w)
        exact = numerator / (s * bracket)
        assert np.abs(study.response / exact - 1).max() < 1e-11, source


def test_value_and_elasticities() -> None:
    value, got = elasticities(LPM, REQUEST, ("motor.area", "motor.volume", "motor.mass", "motor.pressure"))
    assert value == pytest.approx(FREQUENCY, rel=1e-12)
    assert value == pytest.approx(11.47, abs=5e-3)
    assert got == pytest.approx([STIFF / (STIFF + LEAK), -0.5, -0.5, 0.5], rel=1e-11)
    assert got[0] == pytest.approx(0.99989, abs=5e-6)


@pytest.mark.parametrize(
    ("parameter", "change", "expected", "printed"),
    [
        ("motor.volume", 0.4, (1.4**-0.5 - 1) / 0.4, -0.3871),
        ("motor.mass", 1.0, 2**-0.5 - 1, -0.2929),
    ],
)
def test_finite_change(parameter: str, change: float, expected: float, printed: float) -> None:
    done = influence(LPM, {"critical_frequency": REQUEST}, [parameter], change=change)
    got = done.coefficients["critical_frequency"][parameter]
    assert got.value == pytest.approx(expected, rel=1e-11)
    assert got.value == pytest.approx(printed, abs=5e-5)
    assert got.change == change


def test_the_strongest_lever_is_the_area() -> None:
    parameters = ["motor.area", "motor.volume", "motor.mass", "motor.leakage", "motor.viscous_friction"]
    done = influence(LPM, {"critical_frequency": REQUEST}, parameters)
    assert done.by_metric["critical_frequency"] == "motor.area"

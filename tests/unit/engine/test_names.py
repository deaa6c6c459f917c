"""What is told of a name that is no parameter: near ones with their paths."""

from __future__ import annotations

import pytest

from engine.model.names import near, no_parameter

PATHS = ["kp", "ctrl.kp", "ctrl.ki", "inner.ctrl.kp", "motor.mass", "motor.J", "valve.natural_frequency", "w0"]


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("pid.kp", ["kp", "ctrl.kp", "inner.ctrl.kp"]),
        ("Kp", ["kp", "ctrl.kp", "inner.ctrl.kp"]),
        ("motor.mas", ["motor.mass"]),
        ("mass", ["motor.mass"]),
        ("j", ["motor.J"]),
        ("natural_freq", ["valve.natural_frequency"]),
        ("zeta", []),
    ],
)
def test_near_names_come_with_their_paths(path, expected):
    assert near(path, PATHS)[: max(len(expected), 1)] == expected


def test_without_a_near_one_some_are_told():
    assert no_parameter("zeta", PATHS) == (
        "parameter must be one of the system's "
        "(kp, ctrl.kp, ctrl.ki, inner.ctrl.kp, motor.mass, motor.J, valve.natural_frequency, w0), got 'zeta'"
    )
    assert no_parameter("zeta", []) == "parameter must be one of the system's (none), got 'zeta'"
    assert "p11, ...)" in no_parameter("zeta", [f"p{k}" for k in range(500)])

from __future__ import annotations

import numpy as np
import pytest

from engine.recordings.fit import baselines, compare
from engine.recordings.validation.verdict import Grade, grade, remarks

Y = np.array([3.0, 4.0])


@pytest.mark.parametrize(
    ("error", "limit", "expected"),
    [
        (0.009, 10, Grade.BEST),
        (0.05, 10, Grade.PASS),
        (0.2, 10, Grade.FAIL),
        (0.2, 25, Grade.PASS),
        (0.008, 0.5, Grade.FAIL),
    ],
)
def test_the_grade_is_that_of_the_worst_output(error, limit, expected) -> None:
    # y and (1 + error) y differ by error of ||y||
    fits = {"exact": compare(Y, Y), "y": compare(Y, (1 + error) * Y)}
    assert grade(fits, limit) is expected


def test_without_a_relative_error_there_is_no_pass() -> None:
    assert grade({"y": compare(np.zeros(2), np.zeros(2))}) is Grade.FAIL


def test_a_trivial_model_that_does_as_well_is_named() -> None:
    u = np.sin(np.arange(100.0))
    measured = 2 * u
    fit = compare(measured, 1.9 * u)
    said = remarks("y", fit, baselines(measured, u[None]))
    assert len(said) == 1
    assert "a constant gain" in said[0]
    assert "5 %" in said[0]


def test_a_constant_channel_shows_no_dynamics() -> None:
    constant = np.full(50, 3.0)
    said = remarks("y", compare(constant, constant * 1.01), baselines(constant, np.ones((1, 50))))
    assert "constant in the window" in said[0]
    assert len(said) == 1
    silent = np.zeros(50)
    assert "is 0 throughout" in remarks("y", compare(silent, silent + 1), {})[-1]

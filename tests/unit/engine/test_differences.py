"""Differences that converge: smooth functions, kinks, jumps, and functions that exist on one side only."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.analysis.differences import HALVINGS, derivatives


def derivative(function, at, scale=1.0):
    (found,) = derivatives(
        lambda p: np.array([function(p)]), at, scale=scale, base=np.array([function(at)], dtype=float)
    )
    return found


@pytest.mark.parametrize(
    ("function", "at", "expected"),
    [
        (lambda p: math.exp(3 * p), 0.4, 3 * math.exp(1.2)),
        (math.sin, 1e-3, math.cos(1e-3)),
        (lambda p: 1 / p, -0.2, -25.0),
        (lambda _: 7.0, 2.0, 0.0),
    ],
)
def test_a_smooth_function(function, at, expected):
    found = derivative(function, at, scale=abs(at))
    assert not found.one_sided
    assert found.value == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert abs(found.value - expected) <= 4 * found.error + 1e-12 * abs(expected)


def test_a_kink_nearby_is_left_behind():
    """|p - 1.003| at p = 1: the first steps reach beyond the kink."""
    found = derivative(lambda p: 2 + abs(p - 1.003), 1.0)
    assert not found.one_sided
    assert found.value == pytest.approx(-1.0, abs=1e-9)


def test_at_a_kink_the_side_of_the_rising_parameter_counts():
    found = derivative(lambda p: 5 + max(0.0, p - 1.0) * 3 - (1.0 - p if p < 1 else 0.0), 1.0)
    assert found.one_sided
    assert found.value == pytest.approx(3.0, abs=1e-9)
    # the two sides mirrored: central differences alone would say 0 here
    assert derivative(lambda p: 2 + abs(p - 1.0), 1.0).value == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("side", [1, -1])
def test_at_a_jump_the_side_to_which_the_value_belongs_counts(side):
    found = derivative(lambda p: p * p + (10.0 if side * (p - 1) < 0 else 0.0), 1.0)
    assert found.one_sided
    assert found.value == pytest.approx(2.0, abs=1e-8)


def test_a_value_apart_from_both_sides_has_no_derivative():
    found = derivative(lambda p: 1.0 if p == 1.0 else 3.0, 1.0)
    assert (found.value, found.error, found.one_sided) == (None, None, True)


def test_where_only_one_side_exists():
    found = derivative(lambda p: 1 + math.sqrt(1 + p) if p >= 0 else math.nan, 0.0)
    assert found.one_sided
    assert found.value == pytest.approx(0.5, abs=1e-9)


def test_entries_converge_each_for_itself_and_values_are_bounded_in_number():
    asked = []

    def both(p):
        asked.append(p)
        return np.array([p**3, 1.0 if p == 1 else 3.0])

    smooth, apart = derivatives(both, 1.0, scale=1.0, base=np.array([1.0, 1.0]))
    assert smooth.value == pytest.approx(3.0, abs=1e-9)
    assert apart.value is None
    assert len(asked) == 2 * HALVINGS

"""Violations: as they are near to a bound, still in order far from it, finite everywhere, and consistent with their slopes."""

from __future__ import annotations

import numpy as np
import pytest

from optimizers.evaluation.constraint_violation import BROKEN, excess, excess_slopes, signed_excess
from optimizers.evaluation.evaluate import UNSTABLE
from optimizers.problem import Goal


def test_near_the_bound_it_is_the_relative_distance():
    np.testing.assert_allclose(excess(np.array([1.0, 2.0, 5.0, 150.0]), 2.0, 1.0), [-0.5, 0.0, 1.5, 74.0], rtol=1e-15)
    np.testing.assert_allclose(excess(np.array([1.0, 2.0, 5.0]), 2.0, -1.0), [0.5, 0.0, -1.5], rtol=1e-15)
    np.testing.assert_allclose(excess(np.array([-3.0, 0.0, 7.0]), 0.0, 1.0), [-3.0, 0.0, 7.0], rtol=1e-15)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("bound", [3.0, -3.0, 0.0, 1e-12])
def test_of_two_points_far_away_the_nearer_one_is_better(bound, sign):
    far = bound + sign * np.concatenate([np.geomspace(1e-3, 1e300, 607), [np.inf]]) * (abs(bound) or 1.0)
    found = excess(far, bound, sign)
    assert (np.diff(found) > 0).all()
    assert np.isfinite(found).all()
    assert found[-2] < BROKEN == found[-1] < UNSTABLE  # before what has no value, and what is unstable


def test_the_scale_bends_without_a_corner():
    """At 100 the slope is that of the straight part, and beyond it that of 100 + ln(1 + e - 100)."""
    at = np.array([99.999, 100.0, 100.001, 150.0, 1e6])
    np.testing.assert_allclose(excess(at, 0.0, 1.0)[3:], [100 + np.log(51.0), 100 + np.log(999_901.0)], rtol=1e-14)
    slopes = excess_slopes(at, np.ones((5, 1)), 0.0, 1.0)[:, 0]
    h = 1e-6 * at
    by_differences = (excess(at + h, 0.0, 1.0) - excess(at - h, 0.0, 1.0)) / (2 * h)
    np.testing.assert_allclose(slopes, by_differences, rtol=1e-4)


def test_both_bounds_of_a_goal():
    rows = signed_excess(Goal(metric="overshoot", lower=1.0, upper=4.0), np.array([[0.5, 8.0]]))
    np.testing.assert_allclose(rows, [[[-0.875, 1.0]], [[0.5, -7.0]]], rtol=1e-15)

"""Fronts: who dominates whom, the volume that is covered, the knee, against values by hand."""

from __future__ import annotations

import numpy as np
import pytest

from optimizers.search.fronts import hypervolume, knee, scaled, undominated


def test_dominated_rows_are_told_apart() -> None:
    values = np.array([[1.0, 4.0], [2.0, 2.0], [2.0, 3.0], [4.0, 1.0], [4.0, 1.0], [3.0, 3.0]])
    # Of the twins [4, 1] the first one stays.
    assert undominated(values).tolist() == [True, True, False, True, False, False]


def test_three_objectives() -> None:
    values = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    assert undominated(values).tolist() == [True, True, True, False, False]


def test_hypervolume_of_a_staircase() -> None:
    # In units of the box [0, 4]²: steps at (0, 1), (0.25, 0.5), (1, 0); the middle one covers 0.75 * 0.5.
    assert hypervolume(np.array([[0.0, 4.0], [1.0, 2.0], [4.0, 0.0]])) == pytest.approx(0.375)


def test_hypervolume_in_three_dimensions() -> None:
    # Corners of the box cover nothing of it; the point at (½, ½, ½) covers an eighth.
    corners = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]
    assert hypervolume(np.array(corners)) == pytest.approx(0.0)
    ends = [[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0], [0.5, 0.5, 0.5]]
    assert hypervolume(np.array(ends)) == pytest.approx(0.125)


def test_one_point_covers_nothing() -> None:
    assert hypervolume(np.array([[2.0, 3.0]])) == 0.0
    assert knee(np.array([[2.0, 3.0]])) == 0


def test_the_knee_lies_furthest_below_the_line_through_the_ends() -> None:
    x = np.linspace(0.0, 1.0, 11)
    # f2 = (1 - √f1)² is steepest against the line at f1 = 1/4: d/df1 (f1 + (1 - √f1)²) = 0.
    front = np.stack([x**2, (1 - x) ** 2], axis=1)
    assert front[knee(front), 0] == pytest.approx(0.25)


def test_scaling_takes_the_front_as_its_box() -> None:
    assert scaled(np.array([[2.0, 5.0], [4.0, 5.0]])).tolist() == [[0.0, 0.0], [1.0, 0.0]]

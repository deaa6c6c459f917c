"""Designs of experiments: combinations, levels, cells."""

from __future__ import annotations

import numpy as np
import pytest

from optimizers.problem import Axis
from optimizers.search.maps import Combinations, around, places, sample

CONTINUOUS = Axis(parameter="a", lower=0.0, upper=10.0, start=1.0, log=False)
LEVELS = Axis(parameter="b", lower=1.0, upper=16.0, start=1.0, log=False, levels=(1.0, 2.0, 4.0, 8.0, 16.0))


def test_combinations_run_through_the_last_axis_first() -> None:
    design = Combinations([np.array([0.0, 1.0]), np.array([0.0, 0.5, 1.0])])
    assert len(design) == 6
    assert design.shape == (2, 3)
    assert design.rows(1, 4).tolist() == [[0.0, 0.5], [0.0, 1.0], [1.0, 0.0]]


def test_a_discrete_axis_has_its_levels_and_no_more() -> None:
    assert LEVELS.value(places(LEVELS, 21)).tolist() == [1.0, 2.0, 4.0, 8.0, 16.0]
    assert LEVELS.value(places(LEVELS, 3)).tolist() == [1.0, 4.0, 16.0]
    assert CONTINUOUS.value(places(CONTINUOUS, 3)).tolist() == [0.0, 5.0, 10.0]


def test_a_cell_has_its_neighbours_and_stays_within_the_range() -> None:
    assert around(CONTINUOUS, 0.1, 0.2, 3).tolist() == pytest.approx([0.0, 0.1, 0.3])
    assert LEVELS.value(around(LEVELS, 0.5, 0.1, 5)).tolist() == [2.0, 4.0, 8.0]
    assert LEVELS.value(around(LEVELS, 0.0, 0.1, 5)).tolist() == [1.0, 2.0]


@pytest.mark.parametrize("kind", ["sobol", "latin_hypercube"])
def test_a_sample_is_even(kind) -> None:
    points = sample(kind, 64, 2, np.random.default_rng(1))
    assert points.shape == (64, 2)
    # Both put one point into each of 64 equal intervals of every coordinate.
    for column in points.T:
        assert sorted((column * 64).astype(int)) == list(range(64))

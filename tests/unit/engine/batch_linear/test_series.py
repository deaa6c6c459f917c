"""Roots of Chebyshev series by bounds, integrals, and maps of pieces."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import chebyshev

from engine.batch.linear import ladder, series

numbers = st.floats(-0.99, 0.99)


def roots_of(coefficients: np.ndarray) -> np.ndarray:
    work, found = np.zeros((series.DEPTH + 4, series.SIZE + 2)), np.zeros(series.MOST_ROOTS)
    count = series.roots(coefficients, 1e-15 * np.abs(coefficients).sum(), work, found)
    assert count >= 0
    return found[:count]


@given(st.lists(numbers, min_size=0, max_size=9, unique=True), st.floats(0.5, 2.0))
def test_every_root_is_found(places: list[float], factor: float) -> None:
    places = sorted(places)
    if any(b - a < 1e-3 for a, b in pairwise(places)):
        return
    whole = np.zeros(series.SIZE)
    made = chebyshev.chebfromroots(places) if places else np.ones(1)
    whole[: len(made)] = factor * made
    np.testing.assert_allclose(roots_of(whole), places, atol=1e-8)


@pytest.mark.parametrize("gap", [1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("middle", [-0.93, 0.0, 0.411])
def test_a_pair_of_roots_between_any_samples_is_not_missed(gap: float, middle: float) -> None:
    whole = np.zeros(series.SIZE)
    made = chebyshev.chebfromroots([middle - gap / 2, middle + gap / 2])
    whole[: len(made)] = made
    np.testing.assert_allclose(roots_of(whole), [middle - gap / 2, middle + gap / 2], atol=1e-9)


def test_integrals_are_those_of_numpy() -> None:
    c = np.random.default_rng(2).normal(size=series.SIZE) * 0.6 ** np.arange(series.SIZE)
    whole = chebyshev.chebint(c, lbnd=-1)
    assert series.integral_of(c) == pytest.approx(chebyshev.chebval(1.0, whole), rel=1e-13)
    square = chebyshev.chebint(chebyshev.chebmul(c, c), lbnd=-1)
    assert series.integral_of_square(c) == pytest.approx(chebyshev.chebval(1.0, square), rel=1e-13)
    weighted, out = np.zeros(series.SIZE + 3), np.zeros(series.SIZE + 3)
    series.timed(c, 0.7, 0.3, weighted)
    series.antiderivative(weighted, series.SIZE + 1, out)
    expected = chebyshev.chebint(chebyshev.chebmul(c, [1.0, 0.3]), lbnd=-1)
    assert series.value_at(out, series.SIZE + 2, 0.4) == pytest.approx(chebyshev.chebval(0.4, expected), rel=1e-13)


def test_nodes_of_a_wide_piece_are_made_of_nodes_of_its_half() -> None:
    needed = set(ladder.NEEDED.tolist())
    assert set(series.NODES.tolist()) <= needed
    assert all((2 * j if 2 * j <= series.PARTS else 2 * j - series.PARTS) in needed for j in needed)

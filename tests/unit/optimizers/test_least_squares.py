"""Bounds of least squares far beyond what is looked for: closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from optimizers.methods.least_squares import minimize_squares

SAMPLES = np.linspace(0.0, 1.0, 50)


def decay(x: np.ndarray, wanted: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return errors of a e^(-b t) and their slopes."""
    a, b = x
    shape = np.exp(-SAMPLES * b)
    errors = a * shape - wanted[0] * np.exp(-SAMPLES * wanted[1])
    return errors, np.stack([shape, -a * shape * SAMPLES], axis=1)


@pytest.mark.parametrize("most", [1e3, 1e6, 1e12])
@pytest.mark.parametrize("wanted", [(0.03, 5.0), (500.0, 0.5)])
def test_wide_bounds_neither_move_the_start_nor_take_the_answer(most, wanted):
    start = np.array([[0.8 * wanted[0], 1.2 * wanted[1]]])
    found = minimize_squares(lambda x: decay(x, wanted), start, lower=np.zeros(2), upper=np.full(2, most))
    assert found is not None
    assert found.x == pytest.approx(wanted, rel=1e-5)


def test_a_start_on_a_bound_leaves_it_and_an_answer_on_one_is_met():
    wanted = (2.0, 5.0)
    found = minimize_squares(
        lambda x: decay(x, wanted), np.array([[0.0, 20.0]]), lower=np.zeros(2), upper=np.array([1.5, 20.0])
    )
    assert found is not None
    assert found.x[0] == 1.5

"""Random searches by the method gradient beside differential evolution and a local search, both judged by python-control."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import settings

from optimizers.methods import minimize
from optimizers.search.result import Status
from tests.reference.optimizers._searches import Search, search, solved

SEEDS = range(200) if settings().max_examples > 1000 else (0, 1, 2, 3, 152)
"""In 152 the resonance of a scenario all but reaches a gain of 1 at the optimum, where the phase margin jumps."""
WORSE = 1e-3
"""By how much an objective may be worse than that of the other search."""
BEYOND = 2e-6
"""Excess over a bound: goals are met within 1e-6, and the same is left to the judge."""


def judged(made: Search, gains: np.ndarray) -> tuple[float, float]:
    """Return objective and excess as python-control has them; on the edge of a band the earlier of two times counts."""
    return made.judged(gains, exact=True, lenient=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_search_is_worse_than_an_independent_one(seed: int) -> None:
    made = search(seed)
    result = minimize("gradient", made.problem(), {})
    objective, excess = judged(made, np.array([result.best[name] for name in made.names]))
    gains, *_ = solved(made)
    known, broken = made.judged(gains, exact=True)
    feasible = result.status is not Status.INFEASIBLE
    assert result.certificate.valid is feasible
    assert feasible or broken > 0, gains
    if feasible:
        assert excess <= BEYOND
    if feasible and broken <= BEYOND:
        assert objective <= known or objective - known <= WORSE * abs(known), gains  # both may be infinite


def test_the_judge_sees_a_worse_point_and_a_broken_bound() -> None:
    # of the first search: a small step along each gain from the optimum costs more than is allowed, or breaks a bound
    made = search(0)
    gains, known, broken = solved(made)
    assert broken <= 0
    for step in np.vstack([np.eye(len(gains)), -np.eye(len(gains))]):
        objective, excess = judged(made, gains * (1 + 0.1 * step))
        assert objective > known + WORSE * abs(known) or excess > BEYOND

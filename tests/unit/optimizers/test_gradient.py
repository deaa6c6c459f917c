"""The method gradient beyond one descent: kinks, jumps, many candidates, and searches that are gone on with."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from optimizers.evaluation.evaluate import Evaluator
from optimizers.methods import minimize
from optimizers.problem import Problem
from optimizers.search.blocks import in_blocks
from optimizers.search.cross_entropy import search_around
from optimizers.search.result import Status, Unwatched
from optimizers.search.search import Stopped, Tracker
from optimizers.search.successive_linear_programming import Polish
from tests.unit.optimizers.landscapes import landscape

BOX = {"x": (-2.0, 3.0), "y": (-2.0, 3.0)}


def bowl() -> Problem:
    """A bowl within a circle: the nearest point to (3, 2) at the distance 1 from the origin."""
    return landscape({"f": "(x-3)*(x-3) + (y-2)*(y-2)", "g": "x*x + y*y"}, BOX, minimise=["f"], limits={"g": 1.0})


LEAST = (math.hypot(3, 2) - 1) ** 2


def tracker(problem: Problem, budget: int = 10**6) -> Tracker:
    return Tracker(Evaluator(problem), Unwatched(), budget)


class Keeping(Unwatched):
    """Keeps states as text, as a database would; cancels after some of them."""

    def __init__(self, state: str | None = None, patience: int = 10**6) -> None:
        self.state, self.patience = state, patience

    def keep(self, state: Mapping[str, Any]) -> None:
        self.state = json.dumps(state)
        self.patience -= 1

    def kept(self) -> Mapping[str, Any] | None:
        return None if self.state is None else json.loads(self.state)

    def cancelled(self) -> bool:
        return self.patience <= 0


def test_a_search_is_gone_on_with_where_it_was() -> None:
    options = {"starts": 4, "seed": 5, "max_evaluations": 3000}
    whole = minimize("gradient", bowl(), options)
    first = Keeping(patience=2)
    cut = minimize("gradient", bowl(), options, monitor=first)
    assert cut.status is Status.CANCELLED
    assert cut.evaluations < whole.evaluations
    assert first.state is not None
    assert len(json.loads(first.state)["left"]) == 2
    again = minimize("gradient", bowl(), options, monitor=Keeping(first.state))
    assert again.status is whole.status
    assert again.objective == pytest.approx(whole.objective, rel=1e-9)
    assert again.objective == pytest.approx(LEAST, rel=1e-6)
    # Nothing of the first look is done again.
    assert again.evaluations <= whole.evaluations


def test_two_equal_peaks_are_polished_to_the_kink() -> None:
    # |x² - y| + |x - 1| + 1: the largest of four smooth functions; the optimum (1, 1) is a corner of all.
    made = landscape(
        {f"f{k}": f"1 + {s}*(x*x - y) + {t}*(x - 1)" for k, (s, t) in enumerate([(1, 1), (1, -1), (-1, 1), (-1, -1)])}
        | {"level": "2"},
        BOX,
        minimise=["level"],
        limits={f"f{k}": 1.0 for k in range(4)},
    )
    state = tracker(made)
    Polish(state, np.zeros(len(made.goals))).run(np.array([0.5, 0.5]), evaluations=40, radius=0.1)
    assert state.best is not None
    # max_k f_k <= 1 only at (1, 1), the centre of nothing else: x = 3/5, y = 3/5 of the box.
    assert state.best == pytest.approx([0.6, 0.6], abs=1e-6)


def test_a_cloud_follows_a_curved_valley() -> None:
    # H. H. Rosenbrock's valley, raised by 1: from (-1.2, 1) along y = x² to (1, 1).
    made = landscape({"f": "1 + 100*(y - x*x)**2 + (1 - x)**2"}, BOX, minimise=["f"])
    state = tracker(made)
    start = np.array([0.8 / 5, 3.0 / 5])
    best = search_around(state, start, np.random.default_rng(1), rounds=40, size=128)
    assert best == pytest.approx([0.6, 0.6], abs=6e-2)
    assert state.rank[1] == pytest.approx(1.0, abs=5e-2)


def test_blocks_use_the_budget_to_its_last_evaluation() -> None:
    points = np.random.default_rng(0).random((1000, 2))
    state = tracker(bowl(), budget=700)
    rows = []
    with pytest.raises(Stopped):
        rows.extend(part for part, _ in in_blocks(state, points))
    assert state.evaluator.evaluations == 700
    whole = tracker(bowl(), budget=700)
    whole.assess(points[:700])
    assert whole.best is not None
    assert state.best == pytest.approx(whole.best)
    # Every improvement is remembered with its own number, however the points are put together.
    assert [point.evaluation for point in state.history] == [point.evaluation for point in whole.history]

"""The method pareto: known fronts, reached and measured, with their hypervolume and knee."""

from __future__ import annotations

import math

import numpy as np
import pytest

from optimizers.methods import minimize
from optimizers.problem import Problem, ProblemError
from optimizers.search.result import Status, Unwatched
from tests.unit.optimizers.landscapes import landscape

SMALL = {"points": 8, "population": 32, "generations": 10, "seed": 1}


def schaffer(**more: float) -> Problem:
    """f1 = x² + y², f2 = (x - 2)² + y²: on the front y = 0 and 0 <= x <= 2, so √f1 + √f2 = 2 (J. D. Schaffer, 1985)."""
    return landscape(
        {"f1": "x*x + y*y", "f2": "(x-2)*(x-2) + y*y"},
        {"x": (-1.0, 3.0), "y": (-1.0, 1.0)},
        minimise=["f1", "f2"],
        limits=more,
    )


def test_the_front_of_two_parabolas() -> None:
    result = minimize("pareto", schaffer(), SMALL)
    assert result.status is Status.CONVERGED
    front = result.front
    assert front is not None
    values = np.array([[measured.value for measured in point.values] for point in front.points])
    assert 5 <= len(values) <= 8
    assert np.sqrt(values).sum(axis=1) == pytest.approx(np.full(len(values), 2.0), abs=1e-3)
    assert values[:, 0] == pytest.approx(np.sort(values[:, 0]))
    assert front.ideal == pytest.approx((0.0, 0.0), abs=1e-3)
    assert front.nadir == pytest.approx((4.0, 4.0), rel=1e-2)
    # The whole front dominates 1 - 1/6 of its box, since ∫ (2 - √f)² df over 0 … 4 is 16/6; eight points less.
    assert 0.6 < front.hypervolume < 1 - 1 / 6
    # Halfway, at x = 1, both are 1: the point furthest below the line from (0, 4) to (4, 0).
    knee = front.points[front.knee].variables
    assert knee["x"] == pytest.approx(1.0, abs=0.3)
    assert result.best == pytest.approx(knee)


def test_constraints_cut_the_front() -> None:
    result = minimize("pareto", schaffer(f1=1.0), SMALL)
    assert result.front is not None
    values = np.array([[measured.value for measured in point.values] for point in result.front.points])
    assert values[:, 0].max() == pytest.approx(1.0, rel=1e-2)
    assert values[:, 0].max() <= 1.0 + 1e-6
    assert result.front.nadir[1] == pytest.approx(4.0, rel=1e-2)


def test_three_objectives_have_a_surface() -> None:
    # Squared distances to three corners: everything inside their triangle is on the front, nothing outside.
    made = landscape(
        {"a": "x*x + y*y", "b": "(x-1)*(x-1) + y*y", "c": "x*x + (y-1)*(y-1)"},
        {"x": (-1.0, 2.0), "y": (-1.0, 2.0)},
        minimise=["a", "b", "c"],
    )
    result = minimize("pareto", made, SMALL)
    assert result.front is not None
    for point in result.front.points:
        x, y = point.variables["x"], point.variables["y"]
        assert min(x, y) > -0.03
        assert x + y < 1.03


def test_objectives_that_agree_leave_one_point() -> None:
    made = landscape({"a": "1 + x*x", "b": "2 + x*x*x*x"}, {"x": (-1.0, 2.0)}, minimise=["a", "b"])
    result = minimize("pareto", made, SMALL)
    assert result.front is not None
    assert result.best["x"] == pytest.approx(0.0, abs=1e-2)
    assert result.front.points[0].values[0].value == pytest.approx(1.0, abs=1e-4)


def test_one_objective_is_refused() -> None:
    with pytest.raises(ProblemError, match="at least two") as caught:
        minimize("pareto", landscape({"a": "1 + x*x"}, {"x": (-1.0, 2.0)}, minimise=["a"]))
    assert caught.value.at == ("goals",)


def test_goals_that_cannot_be_met_leave_no_front() -> None:
    result = minimize("pareto", landscape(
        {"a": "1 + x*x", "b": "2 - x", "c": "3 + x*x"}, {"x": (-1.0, 1.5)}, minimise=["a", "b"], limits={"c": 2.0}
    ), SMALL)  # fmt: skip
    assert result.status is Status.INFEASIBLE
    assert result.front is None
    assert "peak of c" in result.advice


@pytest.mark.parametrize("patience", [0, 15])
def test_a_cancel_keeps_the_front_until_then(patience) -> None:
    class Impatient(Unwatched):
        def __init__(self) -> None:
            self.asked = 0

        def cancelled(self) -> bool:
            self.asked += 1
            return self.asked > patience

    result = minimize("pareto", schaffer(), SMALL, monitor=Impatient())
    assert result.status is Status.CANCELLED
    assert (result.front is not None) == (patience > 0)
    assert math.isfinite(result.objective)


def test_a_budget_is_kept() -> None:
    result = minimize("pareto", schaffer(), {**SMALL, "max_evaluations": 500})
    assert result.status is Status.BUDGET
    assert result.evaluations <= 500
    assert result.front is not None

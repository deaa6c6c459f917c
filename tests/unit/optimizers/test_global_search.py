"""The method global: the lowest of many valleys, constraints, budgets, repeatability."""

from __future__ import annotations

import math

import pytest

from optimizers.methods import minimize
from optimizers.problem import Problem
from optimizers.search.result import Status, Unwatched
from tests.unit.optimizers.landscapes import landscape

# L. A. Rastrigin's function, raised by 1: about a hundred valleys here, the lowest one is 1 at (0, 0).
VALLEYS = "21 + x*x - 10*cos(2*pi*x) + y*y - 10*cos(2*pi*y)"
BOX = {"x": (-5.0, 4.0), "y": (-4.0, 5.0)}


def valleys() -> Problem:
    return landscape({"f": VALLEYS}, BOX, minimise=["f"])


def test_the_lowest_of_many_valleys_is_found() -> None:
    result = minimize("global", valleys(), {"seed": 1, "restarts": 2})
    assert result.status is Status.CONVERGED
    assert result.objective == pytest.approx(1.0, abs=1e-9)
    assert result.best == pytest.approx({"x": 0.0, "y": 0.0}, abs=1e-5)
    assert "of 3 runs" in result.advice


def test_an_active_constraint_is_met_exactly() -> None:
    # Nearest point to (3, 3) within the circle of radius 2: distance² = (3√2 - 2)².
    made = landscape(
        {"f": "(x-3)*(x-3) + (y-3)*(y-3)", "g": "x*x + y*y"},
        {"x": (-3.0, 3.0), "y": (-3.0, 3.0)},
        minimise=["f"],
        limits={"g": 4.0},
    )
    result = minimize("global", made, {"restarts": 0})
    assert result.certificate.valid
    assert result.objective == pytest.approx((3 * math.sqrt(2) - 2) ** 2, rel=1e-5)
    assert result.best == pytest.approx({"x": math.sqrt(2), "y": math.sqrt(2)}, rel=1e-3)


def test_one_variable_is_enough() -> None:
    made = landscape({"f": "2 + cos(7*x) + x/10"}, {"x": (0.0, 3.0)}, minimise=["f"])
    result = minimize("global", made, {"restarts": 1})
    # sin(7x) = 1/70 on the rising side of the first valley: x = (π - asin(1/70)... )/7 with cos < 0.
    x = (math.pi - math.asin(1 / 70)) / 7
    assert result.best["x"] == pytest.approx(x, abs=1e-5)


def test_a_seed_repeats_the_run() -> None:
    runs = [minimize("global", valleys(), {"seed": 3, "restarts": 0}) for _ in range(2)]
    assert runs[0].best == runs[1].best
    assert runs[0].evaluations == runs[1].evaluations
    assert [point.evaluation for point in runs[0].history] == [point.evaluation for point in runs[1].history]


def test_a_budget_is_kept_and_the_best_point_polished() -> None:
    result = minimize("global", valleys(), {"max_evaluations": 1500})
    assert result.status is Status.BUDGET
    assert result.evaluations <= 1500
    assert "max_evaluations" in result.advice
    assert minimize("global", valleys(), {"max_evaluations": 0}).status is Status.BUDGET


def test_a_cancel_is_heard() -> None:
    class Impatient(Unwatched):
        def __init__(self) -> None:
            self.asked = 0

        def cancelled(self) -> bool:
            self.asked += 1
            return self.asked > 20

    result = minimize("global", valleys(), monitor=Impatient())
    assert result.status is Status.CANCELLED
    assert result.history

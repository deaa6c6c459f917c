"""The method auto: what it chooses for which problem, and that it says why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.optimizers.cases_convex import first_order
from optimizers.methods import minimize
from optimizers.methods.auto import choose
from optimizers.problem import Problem
from optimizers.search.result import Status, Unwatched
from tests.unit.optimizers.drive import fastest, pid_loop
from tests.unit.optimizers.landscapes import landscape


def chosen(problem: Problem) -> tuple[str, str]:
    return choose(problem, np.random.default_rng(0), Unwatched())


def test_objectives_without_weights_make_a_front() -> None:
    made = landscape({"a": "1 + x*x", "b": "2 - x"}, {"x": (-1.0, 1.0)}, minimise=["a", "b"])
    assert chosen(made)[0] == "pareto"
    first, second = made.goals
    assert chosen(replace(made, goals=(replace(first, weight=3.0), second)))[0] == "gradient"


def test_a_few_levels_are_all_evaluated() -> None:
    made = landscape(
        {"f": "1 + (x-3)*(x-3) + (y-5)*(y-5)"}, {"x": (0.0, 9.0), "y": (0.0, 9.0)}, minimise=["f"],
        x={"integer": True}, y={"choices": (1.0, 4.0, 6.0)},
    )  # fmt: skip
    kind, reason = chosen(made)
    assert kind == "grid"
    assert "30 combinations" in reason
    result = minimize("auto", made)
    assert result.advice.startswith("grid was chosen because all variables are discrete")
    assert result.best == {"x": 3.0, "y": 4.0}
    assert result.map is not None
    assert result.map.objective.shape == (10, 3)


def test_a_linear_controller_with_peaks_is_convex() -> None:
    kind, reason = chosen(first_order().problem)
    assert kind == "convex"
    assert "linear in the variables" in reason


def test_a_loop_with_a_delay_is_descended() -> None:
    kind, reason = chosen(fastest(pid_loop(), "kp", "ki"))
    assert kind == "gradient"
    assert "exact slopes" in reason


@pytest.mark.parametrize(("limit", "kind"), [(0.5, "gradient"), (1e-2, "global")])
def test_rare_feasible_points_call_for_a_global_search(limit, kind) -> None:
    # The circle of radius √limit in a square of side 6 has the share π limit / 36 of it: 4 % or 0.09 %.
    made = landscape(
        {"f": "1 + (x+3)*(x+3)", "g": "(x-1)*(x-1) + (y-1)*(y-1)"}, {"x": (-3.0, 3.0), "y": (-3.0, 3.0)},
        minimise=["f"], limits={"g": limit},
    )  # fmt: skip
    assert chosen(made)[0] == kind
    result = minimize("auto", made, {"seed": 1, "max_evaluations": 8000})
    assert result.advice.startswith(f"{kind} was chosen because")
    assert result.certificate.valid
    assert result.best["x"] == pytest.approx(1 - limit**0.5, abs=1e-3)


def test_a_cancel_is_passed_on() -> None:
    class Impatient(Unwatched):
        def cancelled(self) -> bool:
            return True

    made = landscape({"f": "1 + x*x"}, {"x": (-1.0, 1.0)}, minimise=["f"])
    assert minimize("auto", made, monitor=Impatient()).status is Status.CANCELLED

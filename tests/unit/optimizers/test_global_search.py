"""The method global: the lowest of many valleys, constraints, budgets, repeatability."""

from __future__ import annotations

import math

import pytest

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.signals import make
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
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


def test_an_evolution_whose_samples_fall_together_ends_with_what_it_has() -> None:
    """Half of a large population lies on the limit: rounding leaves the strategy with a variance below 0, and it refuses to go on."""
    wires = ["reference -> error.in1", "drive -> error.in2", "error -> controller", "controller -> drive"]
    loop = compile_system(
        System(
            name="position loop",
            parameters={"kp": Parameter(value=4.0, lower=0.5, upper=40.0, scale="log")},
            blocks={
                "reference": Block(kind="input"),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "controller": Block(kind="gain", values={"gain": "=kp"}),
                "drive": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [0.05, 1.0, 0.0]}),
            },
            connections=tuple(Connection(source=a, target=b) for a, b in (wire.split(" -> ") for wire in wires)),
            outputs={"position": "drive"},
        )
    )
    problem = Problem(
        diagram=loop,
        variables=(Variable(parameter="kp", lower=0.5, upper=40.0),),
        experiments=(Experiment(name="step", signals={"reference": make("step", {})}),),
        goals=(
            Goal(metric="response_time", experiment="step", output="position", sense=Sense.MINIMIZE),
            Goal(metric="overshoot", experiment="step", output="position", upper=0.05),
        ),
    )
    result = minimize("global", problem, {"seed": 5, "population": 200, "restarts": 2, "max_evaluations": 400_000})
    assert result.status is Status.CONVERGED
    damping = -math.log(0.05) / math.hypot(math.pi, math.log(0.05))  # of an overshoot of 5 %
    assert result.best["kp"] == pytest.approx(1 / (4 * 0.05 * damping**2), rel=1e-4)

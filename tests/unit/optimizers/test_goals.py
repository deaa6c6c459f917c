"""Goals of every kind on a system of which every answer is known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from engine.model.masks import Corners, Envelope, FrequencyBounds, Polyline
from optimizers.evaluation.evaluate import Evaluator
from optimizers.methods import minimize
from optimizers.problem import Across, Goal, ProblemError, Sense, Uncertain, Variable
from optimizers.search.result import Status
from tests.unit.optimizers.oscillator import STEP, damping_for, problem

FAST = Goal(metric="bandwidth", source="force", target="x", sense=Sense.MAXIMIZE)
CALM = Goal(metric="overshoot", experiment="step", output="x", upper=0.04)
C = Variable(parameter="c", lower=0.1, upper=10.0)
FEW = {"starts": 2, "seed": 1, "max_evaluations": 1500}


def overshoot(**changes: Any) -> Goal:
    return Goal(**{"metric": "overshoot", "experiment": "step", "output": "x", **changes})


def test_a_target_is_hit_within_its_tolerance() -> None:
    made = problem(goals=(FAST, overshoot(aim=0.1, tolerance=1e-3)))
    assert (made.goals[1].lower, made.goals[1].upper) == (0.099, 0.101)
    result = minimize("gradient", made, FEW)
    # More overshoot is more bandwidth: the upper end of the tolerance is reached.
    assert result.goals[1].after.value == pytest.approx(0.101, rel=1e-5)
    assert result.goals[1].score == pytest.approx(1.0, abs=1e-5)


def test_soft_goals_alone_are_balanced() -> None:
    # Overshoot against 0.02 and the gain at 1 rad/s, m = k = 1: |G(j)| = 1/c, against 1. Both bounds relative to themselves.
    gain = Goal(
        metric="path_bound", source="force", target="x", hard=False, weight=2.0,
        mask=FrequencyBounds(lower=Corners(frequencies=(0.99999, 1.0), magnitudes=(1.0, 1.0))),
    )  # fmt: skip
    result = minimize("gradient", problem(goals=(gain, overshoot(upper=0.02, hard=False))), FEW)
    assert result.certificate.valid  # nothing hard is broken
    z = result.best["c"] / 2
    over = math.exp(-math.pi * z / math.sqrt(1 - z * z))
    assert 2 * (result.best["c"] - 1) == pytest.approx(over / 0.02 - 1, rel=1e-3)
    assert not result.goals[0].met
    assert result.objective == pytest.approx(2 * (result.best["c"] - 1), rel=1e-4)


def test_a_soft_goal_beside_an_objective_counts_only_while_it_is_broken() -> None:
    # The weight decides: with little of it the bound is given up, with much of it it holds, and no more than that.
    light = minimize("gradient", problem(goals=(FAST, overshoot(upper=0.04, hard=False, weight=1e-3))), FEW)
    heavy = minimize("gradient", problem(goals=(FAST, overshoot(upper=0.04, hard=False, weight=1e3))), FEW)
    assert light.best["c"] == pytest.approx(0.1)
    assert heavy.best["c"] == pytest.approx(2 * damping_for(0.04), rel=1e-4)
    assert light.goals[1].score == pytest.approx(light.goals[1].after.value / 0.04, rel=1e-9)


def test_slopes_of_the_objective_are_the_limit_of_differences() -> None:
    goals = (FAST, overshoot(upper=0.04, hard=False, weight=0.3), overshoot(aim=0.2, hard=False, weight=0.1))
    variables = (C, Variable(parameter="k", lower=0.5, upper=2.0))
    for across in Across:
        evaluator = Evaluator(problem(goals=goals, variables=variables, scenarios=({}, {"m": 2.0}), across=across))
        x = np.array([0.4, 0.6])
        local = evaluator.local(x)
        assert local is not None
        rows = evaluator.objective_slopes(local)
        # One row for each scenario or their mean, then one for each of the three soft bounds in each scenario.
        assert len(rows) == (2 if across is Across.WORST else 1) + 3 * 2
        for v, step in enumerate(1e-6 * np.eye(2)):
            both = evaluator.objectives(evaluator.assess(np.array([x + step, x - step])).values)
            assert rows[:, v] == pytest.approx((both[0] - both[1]) / 2e-6, rel=1e-5, abs=1e-6)


def test_the_mean_over_scenarios_is_a_mean() -> None:
    made = problem(goals=(FAST,), scenarios=({}, {"k": 4.0}), across=Across.MEAN)
    found = Evaluator(made).assess(np.array([[0.3]]))
    alone = [Evaluator(problem(goals=(FAST,), scenarios=(s,))).assess(np.array([[0.3]])) for s in ({}, {"k": 4.0})]
    assert found.objective[0] == pytest.approx(np.mean([one.objective[0] for one in alone]), rel=1e-12)


def test_an_envelope_is_an_objective_and_a_constraint() -> None:
    mask = Envelope(upper=Polyline(times=(0.0, 30.0), values=(1.04, 1.04)))
    held = Goal(metric="envelope", experiment="step", output="x", mask=mask)
    assert held.upper == 1.0
    result = minimize("gradient", problem(goals=(FAST, held)), FEW)
    assert result.best["c"] == pytest.approx(2 * damping_for(0.04), rel=1e-5)
    follow = Goal(
        metric="tracking_error", experiment="step", output="x", sense=Sense.MINIMIZE,
        mask=Polyline(times=(0.0, 1000.0), values=(1.0, 1.0)),
    )  # fmt: skip
    # ∫e² = ζ + 1/(4ζ) is least at ζ = 1/2.
    assert minimize("gradient", problem(goals=(follow,)), FEW).best["c"] == pytest.approx(1.0, rel=1e-4)


def test_tied_variables_follow() -> None:
    tied = Variable(parameter="c", expression="=2*0.8*sqrt(m*k)")
    made = problem(
        goals=(FAST,), variables=(Variable(parameter="k", lower=0.5, upper=4.0), tied), scenarios=({"m": 2.0},)
    )
    assert made.values([1.0]) == {"k": 4.0, "c": 1.6 * math.sqrt(8.0)}
    result = minimize("gradient", made, FEW)
    assert result.best["c"] == pytest.approx(1.6 * math.sqrt(2 * result.best["k"]), rel=1e-12)
    # With the damping ratio kept, the bandwidth goes with √(k/m): its elasticity is 1/2.
    assert result.goals[0].elasticities["k"] == pytest.approx(0.5, rel=1e-9)


def test_goals_that_fight_each_other_are_named_with_their_shares() -> None:
    # One variable: a gain of at least 1 at 1 rad/s wants c <= 1, an overshoot of 0.02 wants c >= 1.56.
    gain = Goal(
        metric="path_bound", source="force", target="x",
        mask=FrequencyBounds(lower=Corners(frequencies=(0.99999, 1.0), magnitudes=(1.0, 1.0))),
    )  # fmt: skip
    peak = Goal(metric="compliance_peak", source="force", target="x", upper=50.0)
    result = minimize("gradient", problem(goals=(FAST, gain, overshoot(upper=0.02), peak)), FEW)
    assert result.status is Status.INFEASIBLE
    assert set(result.conflict) == {1, 2}
    assert sum(result.conflict.values()) == pytest.approx(1.0, abs=1e-3)
    # Slopes of the two excesses by c: 1 and d(over/0.02)/dc; the shares balance them.
    z = result.best["c"] / 2
    slope = math.pi * math.exp(-math.pi * z / math.sqrt(1 - z * z)) / (1 - z * z) ** 1.5 / 2 / 0.02
    assert result.conflict[1] / result.conflict[2] == pytest.approx(slope, rel=1e-2)
    assert "path_bound of x" in result.advice
    assert "compliance_peak" not in result.advice


@pytest.mark.parametrize(
    ("changes", "at", "message"),
    [
        ({"goals": ()}, ("goals",), "goals must be at least one, got none"),
        ({"scenarios": ({}, {"m": 2.0}), "scenario_names": ("nominal",)}, ("scenarios",), "as many as the scenarios, 2, got 1"),
        ({"goals": (FAST, overshoot(hard=False))}, ("goals", 1), "target"),
        ({"goals": (FAST, overshoot(aim=0.0))}, ("goals", 1, "tolerance"), "target of 0"),
        ({"goals": (FAST, overshoot(aim=0.1, upper=0.2))}, ("goals", 1, "target"), "without lower and upper"),
        ({"goals": (FAST, overshoot(tolerance=0.1, upper=0.2))}, ("goals", 1, "tolerance"), "without a target"),
        ({"goals": (FAST, CALM, overshoot(lower=0.05))}, ("goals", 2, "lower"), "upper bound of goal 1"),
        ({"goals": (FAST, Goal(metric="envelope", experiment="step", output="x", upper=1.0))}, ("goals", 1, "bounds"), "must be given"),
        ({"goals": (FAST, overshoot(upper=0.1, mask=Polyline(times=(0, 1), values=(1, 1))))}, ("goals", 1, "reference"), "left out"),
        ({"variables": (Variable(parameter="c", choices=(1.0,)),)}, ("variables", 0, "choices"), "different values"),
        ({"variables": (Variable(parameter="c", choices=(1.0, 200.0)),)}, ("variables", 0, "choices", 1), "<= 100"),
        ({"variables": (Variable(parameter="c", choices=(1.0, 2.0), lower=1.0),)}, ("variables", 0, "lower"), "beside choices"),
        ({"variables": (Variable(parameter="c", lower=0.2, upper=1.8, integer=True),)}, ("variables", 0, "integer"), "got 1 in"),
        ({"variables": (C, Variable(parameter="k", expression="2*c"))}, ("variables", 1, "expression"), "begin with"),
        ({"variables": (C, Variable(parameter="k", expression="=2*"))}, ("variables", 1, "expression"), "expression"),
        ({"variables": (C, Variable(parameter="k", expression="=2*m"))}, ("variables", 1, "expression"), "at least one variable"),
        ({"variables": (C, Variable(parameter="k", expression="=c*q"))}, ("variables", 1, "expression"), "'q'"),
        ({"variables": (C, Variable(parameter="k", expression="=c", lower=1.0))}, ("variables", 1, "lower"), "beside an expression"),
        ({"variables": (Variable(parameter="k", expression="=c"),)}, ("variables", 0, "expression"), "at least one variable"),
        ({"uncertain": (Uncertain(parameter="c", lower=1.0, upper=2.0),)}, ("uncertain", 0, "parameter"), "two of them"),
        ({"uncertain": (Uncertain(parameter="m", lower=2.0, upper=2.0),)}, ("uncertain", 0, "upper"), "zero width"),
        ({"uncertain": (Uncertain(parameter="q", lower=1.0, upper=2.0),)}, ("uncertain", 0, "parameter"), "'q'"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(changes, at, message) -> None:
    with pytest.raises(ProblemError, match=message) as caught:
        problem(**changes)
    assert caught.value.at == at


def test_the_command_is_the_same_everywhere() -> None:
    assert problem().experiments == (STEP,)


@pytest.mark.parametrize("kind", ["auto", "gradient"])
def test_goals_without_any_sense_are_served_with_most_room(kind: str) -> None:
    # of s² + 2 ζ s + 1: overshoot exp(-π ζ / √(1 - ζ²)), -3 dB where ω² = 1 - 2 ζ² + √((1 - 2 ζ²)² + 10^0.3 - 1); the
    # worse of the two excesses is least where they are equal
    def overshooting(z: float) -> float:
        return math.exp(-math.pi * z / math.sqrt(1 - z * z))

    def reaching(z: float) -> float:
        return math.sqrt(1 - 2 * z * z + math.sqrt((1 - 2 * z * z) ** 2 + 10**0.3 - 1))

    def difference(z: float) -> float:
        return (overshooting(z) / 0.1 - 1) - (1 - reaching(z) / 0.8)

    goals = (overshoot(upper=0.1), Goal(metric="bandwidth", source="force", target="x", lower=0.8))
    found = minimize(kind, problem(goals=goals))
    middle = float(brentq(difference, 0.6, 0.9))
    assert found.status is Status.CONVERGED
    assert found.certificate.valid
    assert found.best["c"] == pytest.approx(2 * middle, rel=1e-5)
    assert found.objective == pytest.approx(overshooting(middle) / 0.1 - 1, rel=1e-5)
    assert [goal.met for goal in found.goals] == [True, True]


def test_goals_without_any_sense_that_nothing_serves_are_infeasible() -> None:
    goals = (overshoot(upper=0.01), Goal(metric="bandwidth", source="force", target="x", lower=1.2))
    found = minimize("gradient", problem(goals=goals), {"starts": 2})
    assert found.status is Status.INFEASIBLE
    assert set(found.conflict) == {0, 1}


def test_a_scenario_is_called_by_its_name() -> None:
    goals = (overshoot(upper=0.04), Goal(metric="bandwidth", source="force", target="x", lower=0.8))
    found = minimize("gradient", problem(goals=goals, scenarios=({}, {"m": 2.0}), scenario_names=(None, "heavy")))
    # ζ = c / (2 √(m k)) is least for the largest mass
    assert found.scenario_names[found.goals[0].scenario] == "heavy"

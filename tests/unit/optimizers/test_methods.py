"""Methods find known optima, agree with each other, and end honestly when they cannot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.signals import make
from optimizers.methods import catalogue, minimize
from optimizers.problem import Experiment, Goal, Problem, ProblemError, Scenario, Sense, Variable
from optimizers.search.result import Status, Unwatched
from tests.unit.optimizers.drive import SCENARIOS, fastest, pd2_loop

STEP = Experiment(name="step", signals={"u": make("step", {})})
SPEED = Goal(metric="response_time", experiment="step", output="y", sense=Sense.MINIMIZE)
# Overshoot exp(-πζ/√(1-ζ²)) = 4 % at this damping; below it the response is faster (up to 5 %, where it jumps).
BEST_DAMPING = -math.log(0.04) / math.hypot(math.pi, math.log(0.04))


def oscillator() -> Diagram:
    return compile_system(
        System(
            parameters={
                "w": Parameter(value=2.0, lower=0.5, upper=10.0, scale="log"),
                "z": Parameter(value=1.5, lower=0.2, upper=2.0),
                "idle": Parameter(value=1.0, lower=0.0, upper=2.0),
            },
            blocks={
                "u": Block(kind="input"),
                "g": Block(
                    kind="transfer_function", values={"numerator": ["=w*w"], "denominator": [1.0, "=2*z*w", "=w*w"]}
                ),
                "beside": Block(kind="gain", values={"gain": "=idle"}),
            },
            connections=(Connection(source="u", target="g"), Connection(source="u", target="beside")),
            outputs={"y": "g", "aside": "beside"},
        )
    )


def problem(
    *goals: Goal,
    variables: tuple[str, ...] = ("z",),
    scenarios: tuple[Scenario, ...] = ({},),
    experiment: Experiment = STEP,
) -> Problem:
    return Problem(
        diagram=oscillator(),
        variables=tuple(Variable(parameter=name) for name in variables),
        experiments=(experiment,),
        goals=goals or (SPEED, OVERSHOOT),
        scenarios=scenarios,
    )


OVERSHOOT = Goal(metric="overshoot", experiment="step", output="y", upper=0.04)


class Watch(Unwatched):
    """Records what a method reports; cancels after a number of questions."""

    def __init__(self, patience: float = math.inf) -> None:
        self.patience = patience
        self.fractions: list[float] = []
        self.bests: list[tuple[float, float]] = []

    def progress(self, fraction: float, message: str) -> None:
        assert message
        self.fractions.append(fraction)

    def best(self, evaluation: int, objective: float, violation: float, variables: Mapping[str, float]) -> None:
        assert evaluation > 0
        assert variables
        self.bests.append((max(violation - 1e-6, 0.0), objective))

    def cancelled(self) -> bool:
        self.patience -= 1
        return self.patience < 0


def test_the_catalogue_finds_methods_by_their_files() -> None:
    assert {"gradient", "grid", "global"} <= set(catalogue())
    for kind, method in catalogue().items():
        assert method.kind == kind
        assert method.__module__.rstrip("_").endswith(kind)  # a module cannot be called global
        assert method.doc
        assert method.source


def test_gradient_finds_the_optimum_at_the_active_bound() -> None:
    watch = Watch()
    result = minimize("gradient", problem(), {"starts": 3, "seed": 1}, monitor=watch)
    assert result.status is Status.CONVERGED
    assert result.best["z"] == pytest.approx(BEST_DAMPING, rel=1e-6)
    speed, overshoot = result.goals
    assert result.certificate.valid
    assert overshoot.active
    assert overshoot.met
    assert overshoot.after.value == pytest.approx(0.04, rel=2e-6)
    assert not speed.active
    assert speed.multiplier is None
    assert speed.before.value is not None
    assert speed.after.value is not None
    assert speed.after.value < speed.before.value
    # d overshoot / d ζ = -π overshoot / (1-ζ²)^1.5, so the elasticity is -πζ/(1-ζ²)^1.5.
    expected = -math.pi * BEST_DAMPING / (1 - BEST_DAMPING**2) ** 1.5
    assert overshoot.elasticities["z"] == pytest.approx(expected, rel=1e-5)
    # Karush-Kuhn-Tucker with one variable: multiplier = -(dT/dζ) / (d overshoot/dζ / bound).
    assert speed.elasticities["z"] is not None
    slope = speed.elasticities["z"] * speed.after.value / BEST_DAMPING
    assert overshoot.multiplier == pytest.approx(-slope / (expected / BEST_DAMPING), rel=1e-3)
    assert watch.fractions == sorted(watch.fractions)
    assert watch.bests == sorted(watch.bests, reverse=True)
    assert [(max(p.violation - 1e-6, 0.0), p.objective) for p in result.history] == watch.bests


def test_the_worst_scenario_counts() -> None:
    slow: Scenario = {"w": 1.0}
    result = minimize("gradient", problem(scenarios=({}, slow)), {"starts": 2})
    assert result.goals[0].scenario == 1
    alone = minimize("gradient", problem(scenarios=(slow,)), {"starts": 2})
    assert result.goals[0].after.value == pytest.approx(alone.goals[0].after.value, rel=1e-6)


def test_a_run_is_repeatable() -> None:
    runs = [
        minimize("gradient", problem(variables=("z", "w")), {"starts": 2, "seed": 7, "max_evaluations": 600})
        for _ in range(2)
    ]
    assert runs[0].best == runs[1].best
    assert runs[0].evaluations == runs[1].evaluations


def test_bounds_are_kept_and_reached_exactly() -> None:
    result = minimize("gradient", problem(variables=("z", "w")), {"starts": 2})
    assert result.best["w"] == 10.0


def test_several_objectives_are_relative_to_before() -> None:
    goals = (
        Goal(metric="bandwidth", source="u", target="y", sense=Sense.MAXIMIZE, weight=1.0),
        Goal(metric="peak_time", experiment="step", output="y", sense=Sense.MINIMIZE, weight=2.0),
    )
    made = problem(*goals, variables=("w",), scenarios=({"z": 0.5},))
    result = minimize("grid", made, {"points": 3})
    before = [goal.before.value for goal in result.goals]
    after = [goal.after.value for goal in result.goals]
    assert None not in before + after
    assert result.history[-1].objective == pytest.approx(-after[0] / before[0] + 2 * after[1] / before[1], rel=1e-6)


def test_grid_keeps_its_map() -> None:
    result = minimize("grid", problem(variables=("z", "w")), {"points": {"z": 10, "w": 3}})
    assert result.map is not None
    assert result.map.objective.shape == (10, 3)
    assert list(result.map.axes) == ["z", "w"]
    assert result.map.axes["z"] == pytest.approx(np.linspace(0.2, 2.0, 10))
    # Overshoot does not depend on w, and the time scales as 1/w.
    assert result.map.violation[0] == pytest.approx(np.full(3, result.map.violation[0, 0]), rel=1e-9)
    assert result.map.objective[5] * result.map.axes["w"] == pytest.approx(
        np.full(3, result.map.objective[5, 2] * 10.0), rel=1e-6
    )
    feasible = np.where(result.map.violation <= 1e-6, result.map.objective, np.inf)
    assert result.best["z"] == pytest.approx(result.map.axes["z"][np.unravel_index(feasible.argmin(), (10, 3))[0]])
    assert result.evaluations == 30


def test_a_refined_grid_approaches_the_gradient() -> None:
    coarse = minimize("grid", problem(), {"points": 11})
    fine = minimize("grid", problem(), {"points": 11, "refine": 4})
    assert coarse.best["z"] - BEST_DAMPING < 1.8 / 10
    assert 0 <= fine.best["z"] - BEST_DAMPING < 1e-3


@pytest.mark.parametrize("points", [2, 3, 4])
def test_a_grid_of_few_points_is_refined(points) -> None:
    coarse = minimize("grid", problem(), {"points": points})
    fine = minimize("grid", problem(), {"points": points, "refine": 8})
    assert coarse.best["z"] - BEST_DAMPING > 0.01
    assert 0 <= fine.best["z"] - BEST_DAMPING < 0.01
    assert "cells that were divided" in fine.advice


@pytest.mark.parametrize("sampling", ["sobol", "latin_hypercube"])
def test_a_sample_has_the_number_of_points_asked_for(sampling) -> None:
    result = minimize("grid", problem(variables=("z", "w")), {"sampling": sampling, "samples": 20, "seed": 3})
    assert result.map is not None
    assert result.map.objective.shape == (20,)
    assert {len(values) for values in result.map.axes.values()} == {20}
    assert result.evaluations == 20


def test_too_large_a_grid_is_refused_with_its_size() -> None:
    with pytest.raises(ProblemError, match="8120601") as caught:
        minimize("grid", problem(variables=("z", "w", "idle")), {"points": 201})
    assert caught.value.at == ("method", "points")


@pytest.mark.parametrize(
    ("kind", "options", "at"),
    [
        ("annealing", {}, ("method", "kind")),
        ("gradient", {"speed": 3}, ("method", "speed")),
        ("gradient", {"starts": 0}, ("method", "starts")),
        ("gradient", {"starts": 2.5}, ("method", "starts")),
        ("gradient", {"starts": True}, ("method", "starts")),
        ("grid", {"sampling": "random"}, ("method", "sampling")),
        ("grid", {"points": {"kp": 3}}, ("method", "points", "kp")),
        ("grid", {"points": {"z": 1}}, ("method", "points")),
    ],
)
def test_wrong_options_are_refused(kind, options, at) -> None:
    with pytest.raises(ProblemError) as caught:
        minimize(kind, problem(), options)
    assert caught.value.at == at


def test_what_cannot_be_met_names_the_conflict() -> None:
    # 4 % overshoot means a peak of 1.04; at least 1.2 is asked for as well.
    result = minimize(
        "gradient",
        problem(SPEED, OVERSHOOT, Goal(metric="peak", experiment="step", output="y", lower=1.2)),
        {"starts": 2},
    )
    assert result.status is Status.INFEASIBLE
    assert "overshoot of y" in result.advice
    assert "peak of y" in result.advice
    # The largest relative violation is least where both are equal: (o - 0.04)/0.04 = (1.2 - 1 - o)/1.2.
    o = (1 + 0.2 / 1.2) / (1 / 0.04 + 1 / 1.2)
    assert result.certificate.worst_violation == pytest.approx((o - 0.04) / 0.04, rel=1e-3)


def test_a_variable_that_changes_nothing_is_named() -> None:
    result = minimize("gradient", problem(variables=("z", "idle")), {"starts": 1, "max_evaluations": 400})
    assert any("idle" in warning for warning in result.warnings)
    assert not any(" z " in warning for warning in result.warnings)


def test_cancel_keeps_the_best_so_far() -> None:
    result = minimize("grid", problem(variables=("z", "w")), {"points": 41}, monitor=Watch(patience=3))
    assert result.status is Status.CANCELLED
    assert result.map is not None
    # Three blocks, whose size follows their time.
    done = int((~np.isnan(result.map.objective)).sum())
    assert done == result.evaluations
    assert 0 < done < 41 * 41
    assert result.certificate.goals
    assert minimize("gradient", problem(), monitor=Watch(patience=0)).status is Status.CANCELLED


@pytest.mark.parametrize("budget", [0, 6])
def test_a_budget_is_kept(budget) -> None:
    result = minimize("gradient", problem(), {"max_evaluations": budget})
    assert result.status is Status.BUDGET
    assert result.evaluations <= budget
    assert "max_evaluations" in result.advice


def test_commands_other_than_steps_are_measured_exactly() -> None:
    # Amplitude 1 at ω = 2 through ω²/(s² + 2ζωs + ω²) settles at 1/(2ζ): the peak falls with ζ.
    sine = Experiment(name="sine", signals={"u": make("sine", {"frequency": 2.0})})
    result = minimize(
        "grid",
        problem(Goal(metric="peak", experiment="sine", output="y", sense=Sense.MINIMIZE), experiment=sine),
        {"points": 3},
    )
    assert result.best["z"] == 2.0
    assert result.certificate.valid


def drive_problem(scenarios: tuple[Scenario, ...] = SCENARIOS, **bounds: tuple[float, float]) -> Problem:
    variables = tuple(Variable(parameter=name, lower=low, upper=high) for name, (low, high) in bounds.items())
    return replace(fastest(pd2_loop(), *bounds, scenarios=scenarios), variables=variables)


def test_nowhere_stable_says_so() -> None:
    # A gain of 50 kp > π/2 / 0.05 s is unstable for every kp > 0.63 without lead.
    made = drive_problem(({"delay": 0.05},), kp=(2.0, 5.0), kd1=(1e-4, 2e-4))
    result = minimize("gradient", made, {"starts": 1})
    assert result.status is Status.INFEASIBLE
    assert "no stable point" in result.advice
    assert not result.certificate.valid
    # The nearer to the edge of stability, the smaller the violation: the best point has the lowest gain.
    assert result.best["kp"] < 2.2


@pytest.mark.parametrize("method", ["gradient", "grid"])
def test_a_scenario_that_nothing_stabilises_is_named(method) -> None:
    # y = k/(s + a): a = -1 is unstable whatever k is.
    made = Problem(
        diagram=compile_system(
            System(
                parameters={"k": Parameter(value=1.0, lower=0.1, upper=5.0), "a": Parameter(value=1.0)},
                blocks={
                    "u": Block(kind="input"),
                    "g": Block(kind="transfer_function", values={"numerator": ["=k"], "denominator": [1.0, "=a"]}),
                },
                connections=(Connection(source="u", target="g"),),
                outputs={"y": "g"},
            )
        ),
        variables=(Variable(parameter="k"),),
        experiments=(STEP,),
        goals=(Goal(metric="peak", experiment="step", output="y", sense=Sense.MINIMIZE),),
        scenarios=({"a": 1.0}, {"a": -1.0}),
    )
    result = minimize(method, made, {})
    assert result.status is Status.INFEASIBLE
    assert "unstable in scenario 1 and stable in the others" in result.advice
    assert not result.certificate.valid


def test_a_metric_that_its_experiment_does_not_define_says_what_it_needs() -> None:
    sine = Experiment(name="sine", signals={"u": make("sine", {"amplitude": 1.0, "frequency": 3.0})})
    goal = Goal(metric="rise_time", experiment="sine", output="y", sense=Sense.MINIMIZE)
    result = minimize("gradient", problem(goal, experiment=sine), {"max_evaluations": 100})
    assert result.status is Status.INFEASIBLE
    assert "rise_time of y has no value (not_applicable: it needs a command that settles" in result.advice
    assert not result.certificate.valid


def test_gradient_and_grid_agree_on_the_drive() -> None:
    box = {"kp": (1.0, 3.0), "kd1": (1e-3, 1e-2)}
    grid = minimize("grid", drive_problem(**box), {"points": 15})
    gradient = minimize("gradient", drive_problem(**box), {"starts": 2, "seed": 1, "max_evaluations": 700})
    assert grid.certificate.valid
    assert gradient.certificate.valid
    assert gradient.goals[0].after.value <= grid.goals[0].after.value * (1 + 1e-6)
    # Neighbours on the grid differ by 3^(1/14) in kp: the optimum lies within two of them.
    assert abs(math.log(gradient.best["kp"] / grid.best["kp"])) < 2 * math.log(3.0) / 14

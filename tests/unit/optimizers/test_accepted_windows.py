"""Goals take what a window says of an output that has not settled in it, unless they accept only what has."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.model.verdicts import Verdict
from engine.signals import make
from optimizers.evaluation.evaluate import Evaluator
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, ProblemError, Sense, Variable
from optimizers.search.result import Status


def servo() -> Diagram:
    """A mass of 1 kg, its force limited to 1 N, under PID control of its position."""
    blocks = {
        "r": Block(kind="input"), "e": Block(kind="sum", values={"signs": "+-"}),
        "c": Block(kind="pid", values={"kp": "=kp", "ki": 0.2, "kd": "=kd", "filter_frequency": 100.0}),
        "s": Block(kind="saturation"), "v": Block(kind="integrator"), "x": Block(kind="integrator"),
    }  # fmt: skip
    wires = [("r", "e.in1"), ("x", "e.in2"), ("e", "c"), ("c", "s"), ("s", "v"), ("v", "x")]
    return compile_system(
        System(
            name="servo", parameters={"kp": Parameter(value=1.0), "kd": Parameter(value=1.0)}, blocks=blocks,
            connections=tuple(Connection(source=source, target=target) for source, target in wires), outputs={"x": "x"},
        )
    )  # fmt: skip


def problem(**more) -> Problem:
    goals = (
        Goal(metric="response_time", experiment="step", output="x", sense=Sense.MINIMIZE, **more),
        Goal(metric="overshoot", experiment="step", output="x", upper=0.2, **more),
    )
    return Problem(
        diagram=servo(),
        variables=tuple(Variable(parameter=name, lower=0.3, upper=30.0, scale="log") for name in ("kp", "kd")),
        experiments=(Experiment(name="step", signals={"r": make("step", {"amplitude": 2.0})}, duration=3.0),),
        goals=goals,
    )


POINTS = np.random.default_rng(3).random((40, 2))


def test_every_candidate_of_a_short_window_has_a_value():
    found = Evaluator(problem()).assess(POINTS)
    assert np.isfinite(found.values).all()


def test_who_accepts_settled_values_only_finds_few():
    strict = Evaluator(problem(accept=Verdict.OK)).assess(POINTS)
    assert np.isnan(strict.values).any(axis=(1, 2)).mean() > 0.5
    assert (strict.violation[np.isnan(strict.objective)] >= 900).all()


def test_an_optimum_of_a_window_says_what_the_rest_may_change():
    found = minimize("grid", problem(), {"points": 9})
    assert found.certificate.valid
    assert found.status is not Status.INFEASIBLE
    for goal in found.goals:
        assert goal.after.verdict in {Verdict.OK, Verdict.NOT_SETTLED}
        assert (goal.after.settled_from == "last_sample") == (goal.after.verdict is Verdict.NOT_SETTLED)
    assert not math.isnan(found.objective)


def test_nothing_else_can_be_accepted():
    with pytest.raises(ProblemError, match="accept must be one of"):
        problem(accept=Verdict.UNSTABLE)

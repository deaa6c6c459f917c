"""Candidates whose structure is not that of the others: the best one is found among them, and one that is no system ends nothing."""

from __future__ import annotations

import math

import pytest

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.signals import make
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable

FASTEST = Goal(metric="rise_time", experiment="step", output="y", sense=Sense.MINIMIZE)


def before_a_lag(numerator: list[float | str], denominator: list[float | str], *, start: float) -> Problem:
    """One variable a, 0 to 1, in the block before 1/(0.1 s + 1)."""
    blocks = {
        "u": Block(kind="input"),
        "first": Block(kind="transfer_function", values={"numerator": numerator, "denominator": denominator}),
        "lag": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [0.1, 1.0]}),
    }
    system = System(
        parameters={"a": Parameter(value=start)},
        blocks=blocks,
        connections=(Connection(source="u", target="first"), Connection(source="first", target="lag")),
        outputs={"y": "lag"},
    )
    return Problem(
        diagram=compile_system(system),
        variables=(Variable(parameter="a", lower=0.0, upper=1.0),),
        experiments=(Experiment(name="step", signals={"u": make("step", {})}),),
        goals=(FASTEST,),
    )


def test_a_grid_finds_the_best_where_a_highest_power_vanishes() -> None:
    # 1/((a s + 1)(0.1 s + 1)) is fastest at a = 0, where it is of first order
    found = minimize("grid", before_a_lag([1.0], ["=a", 1.0], start=0.5), {"points": 5})
    assert found.best["a"] == 0.0
    assert found.objective == pytest.approx(0.1 * math.log(9.0), rel=1e-9)
    assert found.certificate.valid


def test_a_candidate_that_is_no_system_ends_nothing() -> None:
    # 1/(1 - a) of a lag: there is no system at a = 1, and all others rise alike
    found = minimize("grid", before_a_lag([1.0], ["=1-a"], start=0.5), {"points": 5})
    assert found.best["a"] < 1.0
    assert found.objective == pytest.approx(0.1 * math.log(9.0), rel=1e-9)

"""Goals whose metrics take a number: any settling band, an absolute band after a load; in the search and in its certificate."""

from __future__ import annotations

import math

import pytest

from engine.model.metric_options import Options
from engine.signals import make
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, ProblemError, Sense, Variable
from tests.reference.systems import block, system

STEP = Experiment(name="step", signals={"r": make("step", {})})
LOAD = Experiment(name="load", signals={"load": make("step", {"amplitude": 3.0})})


def lag(goal: Goal, *, most: float = 30.0) -> Problem:
    """a / (s + a), the least a that meets the goal: its bandwidth, which is in proportion to a, as small as can be."""
    blocks = {
        "r": block("input"), "load": block("input", role="disturbance"), "sum": block("sum", signs="++"),
        "lag": block("transfer_function", numerator=["=a"], denominator=[1, "=a"]),
        "wash": block("transfer_function", numerator=[1, 0], denominator=[1, "=a"]),
    }  # fmt: skip
    wires = ["r -> lag", "load -> wash", "lag -> sum.in1", "wash -> sum.in2"]
    least = Goal(metric="bandwidth", source="r", target="y", sense=Sense.MINIMIZE)
    return Problem(
        diagram=system(blocks, wires, {"y": "sum"}, {"a": 20.0}),
        variables=(Variable(parameter="a", lower=0.1, upper=most),),
        experiments=(STEP, LOAD),
        goals=(least, goal),
    )


@pytest.mark.parametrize(
    ("goal", "least"),
    [
        # e^(-a t) < band
        (Goal(metric="settling_time", experiment="step", output="y", upper=0.5, options=Options(settling_band=0.1)), math.log(10) / 0.5),
        # a load of 3 leaves 3 e^(-a t)
        (Goal(metric="recovery_time", experiment="load", output="y", upper=0.5, options=Options(recovery_band=0.06)), math.log(50) / 0.5),
        (Goal(metric="spectral_abscissa", upper=-7.0), 7.0),
        # ∫ g² = a/2;  σ² = S a/4
        (Goal(metric="h2_norm", source="r", target="y", lower=3.0), 18.0),
        (Goal(metric="noise_rms", source="r", target="y", lower=0.3, options=Options(noise_density=0.04)), 9.0),
    ],
)  # fmt: skip
def test_the_least_that_meets_it_is_found_and_proven(goal: Goal, least: float) -> None:
    result = minimize("gradient", lag(goal), {"starts": 2, "seed": 1, "max_evaluations": 1500})
    assert result.best["a"] == pytest.approx(least, rel=1e-5)
    assert result.certificate.valid
    assert result.certificate.goals[1].independent == pytest.approx(
        result.certificate.goals[1].measured.value, rel=1e-6
    )


@pytest.mark.parametrize(
    ("goal", "name", "rule"),
    [
        (Goal(metric="recovery_time", experiment="load", output="y", upper=1.0), "recovery_band", "must be given"),
        (Goal(metric="overshoot", experiment="step", output="y", upper=1.0, options=Options(settling_band=0.1)), "settling_band", "must be left out"),
    ],
)  # fmt: skip
def test_a_number_that_is_missing_or_meaningless_is_refused_by_name(goal: Goal, name: str, rule: str) -> None:
    with pytest.raises(ProblemError, match=f"{name} {rule}") as error:
        lag(goal)
    assert error.value.at == ("goals", 1, name)

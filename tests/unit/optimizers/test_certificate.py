"""A certificate looks where an optimiser does not: between samples and between frequencies."""

from __future__ import annotations

import numpy as np
import pytest

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.model.metric_options import Options
from engine.model.verdicts import Measured, Verdict
from engine.signals import make
from optimizers.evaluation.certificate import certify, violation_of, worst_scenario
from optimizers.evaluation.constraint_violation import BROKEN
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable


def needle(upper: float) -> Problem:
    """A slow lag beside a lightly damped mode of height 3: |y/u| has a needle at 1 rad/s."""
    return Problem(
        diagram=compile_system(
            System(
                parameters={"h": Parameter(value=3.0)},
                blocks={
                    "u": Block(kind="input"),
                    "slow": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [1.0, 1.0]}),
                    "mode": Block(
                        kind="transfer_function",
                        values={"numerator": ["=0.002*h", 0.0], "denominator": [1.0, 0.002, 1.0]},
                    ),
                    "sum": Block(kind="sum", values={"signs": "++"}),
                },
                connections=tuple(
                    Connection(source=a, target=b)
                    for a, b in (("u", "slow"), ("u", "mode"), ("slow", "sum.in1"), ("mode", "sum.in2"))
                ),
                outputs={"y": "sum"},
            )
        ),
        variables=(Variable(parameter="h", lower=1e-3, upper=100.0),),
        goals=(Goal(metric="compliance_peak", source="u", target="y", sense=Sense.MINIMIZE, upper=upper),),
    )


def test_a_needle_between_frequencies_is_refused() -> None:
    omega = np.geomspace(1e-2, 1e2, 150)
    mode = 0.006j * omega / (1 - omega**2 + 0.002j * omega)
    assert np.abs(1 / (1 + 1j * omega) + mode).max() < 1.05
    certificate = certify(needle(1.05), {"h": 3.0})
    assert not certificate.valid
    (proof,) = certificate.goals
    # At ω = 1 the two add to |3 + 1/(1 + j)| = |3.5 - 0.5j|; the summit lies within the needle's width of it.
    assert proof.measured.at == pytest.approx(1.0, abs=1e-3)
    assert proof.measured.value == pytest.approx(abs(3.5 - 0.5j), rel=1e-2)
    assert certificate.worst_violation == pytest.approx(proof.measured.value / 1.05 - 1, rel=1e-12)


def test_a_point_that_meets_every_goal_is_valid() -> None:
    certificate = certify(needle(3.6), {"h": 3.0})
    assert certificate.valid
    assert certificate.worst_violation == 0.0


def test_a_spike_between_samples_is_refused() -> None:
    # s/(f s + 1) 1/(s + 1) answers a step with (e^-t - e^(-t/f)) / (1 - f): on 101 samples of 0...10 s it stays below
    # 0.95, between the first two it reaches f^(f/(1-f)) at t = f ln(1/f) / (1 - f).
    f = 1e-3
    problem = Problem(
        diagram=compile_system(
            System(
                parameters={"f": Parameter(value=f)},
                blocks={
                    "u": Block(kind="input"),
                    "slow": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [1.0, 1.0]}),
                    "rate": Block(
                        kind="transfer_function", values={"numerator": [1.0, 0.0], "denominator": ["=f", 1.0]}
                    ),
                },
                connections=(Connection(source="u", target="slow"), Connection(source="slow", target="rate")),
                outputs={"rate": "rate"},
            )
        ),
        variables=(Variable(parameter="f", lower=1e-4, upper=1.0),),
        experiments=(Experiment(name="step", signals={"u": make("step", {})}),),
        goals=(
            Goal(
                metric="max_velocity",
                experiment="step",
                output="rate",
                sense=Sense.MINIMIZE,
                upper=0.95,
                options=Options(derivative=0),
            ),
        ),
    )
    time = np.linspace(0.0, 10.0, 101)
    assert ((np.exp(-time) - np.exp(-time / f)) / (1 - f)).max() < 0.95
    (proof,) = certify(problem, {"f": f}).goals
    assert proof.measured.at == pytest.approx(f * np.log(1 / f) / (1 - f), rel=1e-6)
    assert proof.violation == pytest.approx(f ** (f / (1 - f)) / 0.95 - 1, rel=1e-6)


def metric(value: float | None, verdict: Verdict = Verdict.OK) -> Measured:
    return Measured(value=value, unit="1", verdict=verdict)


@pytest.mark.parametrize(
    ("goal", "measured", "violation"),
    [
        (Goal(metric="overshoot", upper=0.1), metric(0.11), 0.1),  # (0.11 - 0.1) / 0.1
        (Goal(metric="overshoot", upper=0.0), metric(2e-7), 2e-7),  # plain where the bound is 0
        (Goal(metric="overshoot", upper=0.1), metric(0.05), 0.0),
        (Goal(metric="bandwidth", lower=30.0), metric(27.0), 0.1),
        (Goal(metric="bandwidth", lower=30.0), metric(None, Verdict.NEVER_CROSSES), 0.0),  # counts as infinite
        (Goal(metric="phase_margin", upper=1.0), metric(None, Verdict.NEVER_CROSSES), BROKEN),
        (Goal(metric="rise_time", upper=1.0), metric(None, Verdict.NEVER_CROSSES), BROKEN),
        (Goal(metric="gain_margin", lower=2.0), metric(None, Verdict.UNSTABLE), BROKEN),
        (Goal(metric="peak", lower=-2.0, upper=-1.0), metric(-0.5), 0.5),
    ],
)
def test_violations(goal, measured, violation) -> None:
    assert violation_of(goal, measured) == pytest.approx(violation, rel=1e-12)


def test_the_worst_scenario_depends_on_what_is_wanted() -> None:
    values = [metric(1.0), metric(3.0), metric(2.0)]
    assert worst_scenario(Goal(metric="peak", sense=Sense.MINIMIZE), values) == 1
    assert worst_scenario(Goal(metric="peak", sense=Sense.MAXIMIZE), values) == 0
    assert worst_scenario(Goal(metric="peak", lower=2.5), values) == 0
    assert worst_scenario(Goal(metric="peak", upper=2.5), [metric(None, Verdict.UNSTABLE), *values]) == 0

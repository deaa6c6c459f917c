"""What cannot be optimised is refused with its place and its reason."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from optimizers.problem import Axis, Experiment, Goal, Problem, ProblemError, Sense, Variable
from tests.unit.optimizers.drive import STEP, pid_loop

FAST = Goal(metric="response_time", experiment="step", output="position", sense=Sense.MINIMIZE)
KP = Variable(parameter="kp")


def problem(**changes: Any) -> Problem:
    parts: dict[str, Any] = {"diagram": pid_loop(), "variables": (KP,), "experiments": (STEP,), "goals": (FAST,)}
    return Problem(**{**parts, **changes})


def test_defaults_come_from_the_parameter() -> None:
    (axis,) = problem().axes
    assert (axis.lower, axis.upper, axis.log, axis.start) == (0.2, 5.0, True, 1.0)


def test_the_unit_cube_reaches_the_bounds_exactly() -> None:
    axis = Axis(parameter="p", lower=0.3, upper=0.7, start=0.5, log=True)
    assert axis.value(0.0) == 0.3
    assert axis.value(1.0) == 0.7
    assert axis.position(float(axis.value(0.37))) == pytest.approx(0.37, rel=1e-14)
    # d value / d position by the difference over a short way
    assert (axis.value(0.5 + 1e-6) - axis.value(0.5 - 1e-6)) / 2e-6 == pytest.approx(
        axis.slope(float(axis.value(0.5))), rel=1e-8
    )


def test_a_log_scale_needs_positive_bounds_only_when_asked_for() -> None:
    assert not problem(variables=(Variable(parameter="velocity_gain", lower=0.0, upper=100.0),)).axes[0].log
    with pytest.raises(ProblemError, match="logarithmic") as caught:
        problem(variables=(Variable(parameter="velocity_gain", lower=0.0, upper=100.0, scale="log"),))
    assert caught.value.at == ("variables", 0, "lower")


@pytest.mark.parametrize(
    ("changes", "at", "message"),
    [
        ({"variables": ()}, ("variables",), "at least one"),
        ({"scenarios": ()}, ("scenarios",), "at least one"),
        ({"variables": (Variable(parameter="kx"),)}, ("variables", 0, "parameter"), "kx"),
        ({"variables": (KP, KP)}, ("variables", 1, "parameter"), "twice"),
        ({"variables": (Variable(parameter="lag"),)}, ("variables", 0, "lower"), "must be given"),
        ({"variables": (Variable(parameter="controller.kp", lower=1.0, upper=2.0),)}, ("variables", 0, "parameter"), "expression"),
        ({"variables": (Variable(parameter="kp", lower=1.0, upper=1.0),)}, ("variables", 0, "upper"), "zero width"),
        ({"variables": (Variable(parameter="kp", lower=2.0, upper=1.0),)}, ("variables", 0, "upper"), "> lower 2"),
        ({"variables": (Variable(parameter="kp", upper=50.0),)}, ("variables", 0, "upper"), "<= 5"),
        ({"variables": (Variable(parameter="kp", start=9.0),)}, ("variables", 0, "start"), "within"),
        ({"variables": (Variable(parameter="kp", scale="cubic"),)}, ("variables", 0, "scale"), "cubic"),
        ({"goals": (Goal(metric="speed", sense=Sense.MINIMIZE),)}, ("goals", 0, "metric"), "speed"),
        ({"goals": (FAST, Goal(metric="overshoot", experiment="step", output="position"))}, ("goals", 1), "sense"),
        ({"goals": (FAST, Goal(metric="overshoot", experiment="load", output="position", upper=0.0))}, ("goals", 1, "experiment"), "load"),
        ({"goals": (FAST, Goal(metric="overshoot", experiment="step", upper=0.0))}, ("goals", 1, "output"), "must be given"),
        ({"goals": (FAST, Goal(metric="overshoot", experiment="step", output="x", upper=0.0))}, ("goals", 1, "output"), "'x'"),
        ({"goals": (FAST, Goal(metric="bandwidth", target="position", lower=1.0))}, ("goals", 1, "from"), "must be given"),
        ({"goals": (FAST, Goal(metric="bandwidth", source="r", target="position", lower=1.0))}, ("goals", 1, "from"), "'r'"),
        ({"goals": (FAST, Goal(metric="sensitivity_peak", upper=1.6))}, ("goals", 1, "open_at"), "must be given"),
        ({"goals": (FAST, Goal(metric="sensitivity_peak", open_at="nowhere", upper=1.6))}, ("goals", 1, "open_at"), "nowhere"),
        ({"goals": (FAST, Goal(metric="sensitivity_peak", open_at="error", lower=2.0, upper=1.6))}, ("goals", 1, "upper"), ">= lower"),
        ({"goals": (FAST, Goal(metric="sensitivity_peak", open_at="error", upper=float("nan")))}, ("goals", 1, "upper"), "finite"),
        ({"goals": (Goal(metric="overshoot", experiment="step", output="position", sense=Sense.MINIMIZE, weight=0.0),)}, ("goals", 0, "weight"), "> 0"),
        ({"goals": (FAST, Goal(metric="band_energy", experiment="step", output="position", upper=1.0, band=(2.0, 1.0)))}, ("goals", 1, "band"), "low < high"),
        ({"experiments": (Experiment(name="step", signals={}),)}, ("experiments", 0, "input"), "at least one"),
        ({"experiments": (Experiment(name="step", signals={"load": STEP.signals["reference"]}),)}, ("experiments", 0, "input", "port"), "load"),
        ({"experiments": (Experiment(name="step", signals=STEP.signals, duration=0.0),)}, ("experiments", 0, "duration"), "> 0 s"),
        ({"scenarios": ({"mass": 1.0},)}, ("scenarios", 0, "mass"), "mass"),
        ({"scenarios": ({"kp": 1.0},)}, ("scenarios", 0, "kp"), "both"),
        ({"scenarios": ({"kp": 1.0},), "scenario_names": ("heavy",)}, ("scenarios", 0, "parameters", "kp"), "both"),
        ({"scenarios": ({"lag": float("inf")},)}, ("scenarios", 0, "lag"), "finite"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(changes, at, message) -> None:
    with pytest.raises(ProblemError, match=message) as caught:
        problem(**changes)
    assert caught.value.at == at


def test_the_present_values_are_those_of_the_system() -> None:
    diagram = compile_system(
        System(
            parameters={"k": Parameter(value=9.0)},
            blocks={
                "u": Block(kind="input"),
                "g": Block(kind="gain", values={"gain": "=k"}),
                "i": Block(kind="integrator"),
            },
            connections=(Connection(source="u", target="g"), Connection(source="g", target="i")),
            outputs={"y": "g"},
        )
    )
    made = Problem(
        diagram=diagram,
        variables=(Variable(parameter="k", lower=1.0, upper=4.0),),
        experiments=(Experiment(name="step", signals={"u": STEP.signals["reference"]}),),
        goals=(Goal(metric="peak", experiment="step", output="y", sense=Sense.MAXIMIZE),),
    )
    assert made.before == {"k": 9.0}  # outside the bounds, and still what "before" means
    assert made.values(made.start()) == {"k": 4.0}
    assert np.array_equal(made.start(), [1.0])

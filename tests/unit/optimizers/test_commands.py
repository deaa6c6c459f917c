"""Numbers of commands as variables: optima known in closed form, exact slopes, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.signals import make
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, ProblemError, Sense, Variable
from optimizers.search.result import Status

W, Z = 20.0, 0.1
DAMPED = W * math.sqrt(1 - Z**2)
DELAYED = make("programmed_delay", {"delay": 0.1, "share": 0.3, "command": {"kind": "step"}})
TRAPEZOID = make("trapezoid", {"max_velocity": 2.0, "max_acceleration": 8.0})


def arm():
    """Return a mode behind a gain ``k``."""
    return compile_system(
        System(
            parameters={"k": Parameter(value=1.0, lower=0.5, upper=4.0)},
            blocks={
                "drive": Block(kind="input"),
                "mode": Block(
                    kind="transfer_function",
                    values={"numerator": ["=400*k"], "denominator": [1.0, 2 * Z * W, W**2]},
                ),
            },
            connections=(Connection(source="drive", target="mode"),),
            outputs={"position": "mode"},
        )
    )


def problem(signal=DELAYED, **fields) -> Problem:
    return Problem(
        **{
            "diagram": arm(),
            "variables": (
                Variable(parameter="signals.move.drive.delay", lower=0.05, upper=0.25),
                Variable(parameter="signals.move.drive.share"),
            ),
            "experiments": (Experiment(name="move", signals={"drive": signal}),),
            "goals": (Goal(metric="residual_vibration", experiment="move", output="position", sense=Sense.MINIMIZE),),
            **fields,
        }
    )


def test_the_best_delay_and_share_are_those_of_the_zero_vibration_shaper() -> None:
    found = minimize("gradient", problem(), {"starts": 1, "seed": 1, "max_evaluations": 60})
    ratio = math.exp(-math.pi * Z / math.sqrt(1 - Z**2))
    # Singer and Seering 1990: half a damped period, and K/(1 + K) of the movement
    assert found.best["signals.move.drive.delay"] == pytest.approx(math.pi / DAMPED, rel=1e-3)
    assert found.best["signals.move.drive.share"] == pytest.approx(ratio / (1 + ratio), rel=1e-3)
    assert found.goals[0].before.value > 0.1
    assert found.goals[0].after.value < 1e-3
    assert found.certificate.valid


def test_a_number_of_a_command_and_one_of_the_system_are_chosen_together() -> None:
    # the fastest movement within two bounds: final value 2 = k · 1, and ramps that last one damped period or so
    variables = (
        Variable(parameter="k"),
        Variable(parameter="signals.move.drive.max_acceleration", lower=2.0, upper=50.0),
    )
    goals = (
        Goal(metric="settling_time", experiment="move", output="position", sense=Sense.MINIMIZE),
        Goal(metric="peak", experiment="move", output="position", lower=2.0, upper=2.1),
        Goal(metric="residual_vibration", experiment="move", output="position", upper=0.02),
    )
    found = minimize(
        "gradient",
        problem(TRAPEZOID, variables=variables, goals=goals),
        {"starts": 1, "seed": 1, "max_evaluations": 60},
    )
    assert found.status in {Status.CONVERGED, Status.STALLED, Status.BUDGET}
    assert found.certificate.valid
    # the largest value of a position that overshoots by at most 0.02 lies in the bounds of its goal
    assert 1.9 < found.best["k"] <= 2.1
    assert found.goals[2].after.value <= 0.02 * (1 + 1e-6)


def test_a_grid_may_vary_commands() -> None:
    variables = (
        Variable(parameter="signals.move.drive.delay", lower=0.5 * math.pi / DAMPED, upper=1.5 * math.pi / DAMPED),
    )
    found = minimize("grid", problem(variables=variables), {"points": 5})
    assert found.best["signals.move.drive.delay"] == pytest.approx(math.pi / DAMPED, rel=1e-9)


def test_what_a_command_refuses_together_is_no_candidate() -> None:
    # ei shapers end at a damping ratio of 0.3
    shaped = make("shaped", {"shaper": "ei", "frequency": W, "damping_ratio": 0.1, "command": {"kind": "step"}})
    variables = (Variable(parameter="signals.move.drive.damping_ratio", lower=0.0, upper=0.6),)
    found = minimize("grid", problem(shaped, variables=variables), {"points": 5})
    assert found.best["signals.move.drive.damping_ratio"] <= 0.3


@pytest.mark.parametrize(
    ("variable", "at", "message"),
    [
        (Variable(parameter="signals.turn.drive.delay"), ("variables", 0, "parameter"), r"begin with one of signals\.move\.drive"),
        (Variable(parameter="signals.move.drive.height"), ("variables", 0, "parameter"), "must be one of delay, share"),
        (Variable(parameter="signals.move.drive.delay"), ("variables", 0, "upper"), "upper must be given"),
        (Variable(parameter="signals.move.drive.share", upper=2.0), ("variables", 0, "upper"), "must be <= 1"),
    ],
)  # fmt: skip
def test_refuses(variable, at, message) -> None:
    with pytest.raises(ProblemError, match=message) as caught:
        problem(variables=(variable,))
    assert caught.value.at == at


def test_refuses_a_bound_that_the_command_does_not_reach() -> None:
    variable = Variable(parameter="signals.move.drive.max_velocity", lower=0.0, upper=1.0)
    with pytest.raises(ProblemError, match="must be > 0"):
        problem(TRAPEZOID, variables=(variable,))


def matrices() -> Problem:
    """Return the same search for a mode given by matrices: a system without a single number of its own."""
    diagram = compile_system(
        System(
            blocks={
                "drive": Block(kind="input"),
                "mode": Block(
                    kind="state_space",
                    values={
                        "A": [[0.0, 1.0], [-(W**2), -2 * Z * W]],
                        "B": [[0.0], [W**2]],
                        "C": [[1.0, 0.0]],
                        "D": [[0.0]],
                    },
                ),
            },
            connections=(Connection(source="drive", target="mode"),),
            outputs={"position": "mode"},
        )
    )
    assert not diagram.parameters
    return problem(diagram=diagram)


@pytest.mark.parametrize("method", ["gradient", "grid"])
def test_commands_of_a_system_without_a_number_of_its_own_are_varied(method: str) -> None:
    half = math.pi / DAMPED
    variables = (Variable(parameter="signals.move.drive.delay", lower=0.5 * half, upper=1.5 * half),)
    asked = replace(matrices(), variables=variables)
    found = minimize(method, asked, {"points": 5} if method == "grid" else {"starts": 1, "max_evaluations": 60})
    # Singer and Seering 1990: half a damped period, whatever the shares are
    assert found.best["signals.move.drive.delay"] == pytest.approx(half, rel=1e-3)
    assert found.certificate.valid

"""What becomes of the goals when a variable moves a little, on systems of which every answer is known."""

from __future__ import annotations

import math

import pytest

from engine.diagram.diagram import compile_system
from engine.signals import make
from optimizers.problem import Experiment, Goal, Problem, Sense, Uncertain, Variable
from optimizers.search.limits import Limited
from optimizers.search.result import Status, Unwatched
from optimizers.solving.solve import solve
from tests.unit.engine.diagrams import block, document
from tests.unit.optimizers.oscillator import damping_for, problem

FEW = {"starts": 2, "seed": 1, "max_evaluations": 1500}


def overshoot(c: float) -> float:
    z = c / 2
    return math.exp(-math.pi * z / math.sqrt(1 - z * z))


def test_a_variable_moves_by_one_percent_of_its_value() -> None:
    found = solve("gradient", problem(), FEW)
    best = found.best["c"]
    down, up = found.moves["c"]["down"], found.moves["c"]["up"]
    assert (down.value, up.value) == pytest.approx((0.99 * best, 1.01 * best), rel=1e-12)
    assert down.values[1] == pytest.approx(overshoot(0.99 * best), rel=1e-6)
    assert up.values[1] == pytest.approx(overshoot(1.01 * best), rel=1e-6)
    assert down.violation == pytest.approx(overshoot(0.99 * best) / 0.04 - 1, rel=1e-5)
    assert up.violation == 0.0
    assert -up.objective == pytest.approx(up.values[0])
    # a bound that is reached is broken a little on one side: that is no needle
    assert not any("c at" in warning for warning in found.warnings)


def test_a_bound_is_in_the_way_and_a_level_is_the_next_one() -> None:
    fastest = (Goal(metric="bandwidth", source="force", target="x", sense=Sense.MAXIMIZE),)
    found = solve("gradient", problem(goals=fastest), FEW)
    assert found.best["c"] == 0.1
    assert found.moves["c"]["down"] is None
    assert found.moves["c"]["up"].value == pytest.approx(0.101)
    levels = (Variable(parameter="c", choices=(0.5, 1.0, 2.0)),)
    chosen = solve(
        "grid",
        problem(variables=levels, goals=(Goal(metric="overshoot", experiment="step", output="x", upper=0.2),)),
        {},
    )
    assert chosen.best["c"] == 2.0
    assert chosen.moves["c"]["down"].value == 1.0
    assert chosen.moves["c"]["up"] is None


def test_an_optimum_at_the_edge_of_a_jump_is_told() -> None:
    # the 2 % settling time of s² + 2 ζ s + 1 is least where the overshoot is just 2 %: with a little less damping it lasts
    # until the first swing has come back into the band
    goals = (Goal(metric="settling_time", experiment="step", output="x", sense=Sense.MINIMIZE),)
    found = solve("gradient", problem(goals=goals), FEW)
    assert found.best["c"] == pytest.approx(2 * damping_for(0.02), rel=1e-4)
    down = found.moves["c"]["down"]
    assert down.objective > 1.1 * found.objective
    assert any("variable c at" in warning and "set that exactly" in warning for warning in found.warnings)


def test_the_worst_of_a_range_counts() -> None:
    mass = Uncertain(parameter="m", lower=0.5, upper=2.0)
    found = solve("gradient", problem(uncertain=(mass,)), FEW)
    best = found.best["c"]
    assert found.moves["c"]["down"].values[1] == pytest.approx(overshoot(0.99 * best / math.sqrt(2)), rel=1e-6)


def test_who_wants_to_stop_is_not_kept_waiting() -> None:
    class Leaving(Unwatched):
        def cancelled(self) -> bool:
            return True

    assert solve("gradient", problem(), FEW, monitor=Leaving()).moves == {}


def test_a_search_that_ends_by_its_time_says_how_sharp_its_best_point_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left of the time is for that as for the proof: a needle that a limited search has found was no needle."""
    goals = (Goal(metric="settling_time", experiment="step", output="x", sense=Sense.MINIMIZE),)
    monkeypatch.setattr(Limited, "_late", lambda limited: len(limited.found) > 0)
    monkeypatch.setattr(Limited, "found", [], raising=False)
    monkeypatch.setattr(Limited, "best", lambda limited, *point: limited.found.append(point))
    found = solve("gradient", problem(goals=goals), FEW | {"max_seconds": 1e6})
    assert found.status is Status.BUDGET
    best, moves = found.best["c"], found.moves["c"]
    assert (moves["down"].value, moves["up"].value) == pytest.approx((0.99 * best, 1.01 * best), rel=1e-12)


def test_a_share_of_nothing_is_not_told() -> None:
    """The shaper of the mode's own frequency leaves nothing: how many times nothing the next frequency leaves is no number to be told."""
    made = compile_system(
        document({"r": block("input"), "p": block("transfer_function", numerator=[100.0], denominator=[1.0, 1.0, 100.0])}, ["r -> p"], {"y": "p"})
    )  # fmt: skip
    command = make("shaped", {"shaper": "zv", "frequency": 10.0, "damping_ratio": 0.05, "command": {"kind": "step"}})
    asked = Problem(
        diagram=made, variables=(Variable(parameter="signals.a.r.frequency", lower=8.0, upper=12.5),),
        goals=(Goal(metric="residual_vibration", experiment="a", output="y", sense=Sense.MINIMIZE),),
        experiments=(Experiment(name="a", signals={"r": command}),),
    )  # fmt: skip
    found = solve("grid", asked, {"points": 3})
    assert found.best["signals.a.r.frequency"] == pytest.approx(10.0, rel=1e-6)
    told = [warning for warning in found.warnings if "signals.a.r.frequency" in warning]
    assert len(told) == 2
    assert len(found.warnings) == 2  # 2e-16 and 4e-14 are the same nothing of a movement of 1
    assert all(
        "makes the objective 0.01" in warning and "in the place of" in warning and "%" not in warning
        for warning in told
    )

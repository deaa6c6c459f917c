"""Bounds that cannot be kept, say nothing or are in another unit."""

from __future__ import annotations

import math

import pytest

from engine.metrics import catalogue
from optimizers.problem import Goal, Problem, ProblemError, Sense, Variable
from tests.unit.optimizers.drive import STEP, pid_loop

AIM = Goal(metric="rise_time", experiment="step", output="position", sense=Sense.MINIMIZE)


def problem(metric: str, **bounds: float | bool) -> Problem:
    goal = Goal(metric=metric, experiment="step", output="position", open_at="error", **bounds)
    return Problem(
        diagram=pid_loop(), variables=(Variable(parameter="kp"),), experiments=(STEP,), goals=(AIM, goal)
    )  # fmt: skip


@pytest.mark.parametrize(
    ("metric", "bounds", "key", "says"),
    [
        ("phase_margin", {"lower": 50.0}, "lower", "lower of phase_margin (goals compare |φ|) must be <= pi rad, got 50 rad: did you mean 50 deg?"),
        ("phase_margin", {"upper": -0.5}, "upper", "must be >= 0 rad, got -0.5 rad"),
        ("phase_margin", {"aim": 60.0}, "target", "target of phase_margin (goals compare |φ|) must be <= pi rad, got 60 rad: did you mean 60 deg?"),
        ("damping_ratio", {"lower": 70.0}, "lower", "lower of damping_ratio must be <= 1, got 70: did you mean 70 %?"),
        ("gain_margin", {"upper": 0.5}, "upper", "upper of gain_margin (goals compare max(g, 1/g)) must be >= 1, got 0.5"),
        ("gain_margin_down", {"upper": 0.5}, "upper", "upper of gain_margin_down (goals compare 1/g) must be >= 1, got 0.5"),
        ("overshoot", {"upper": -0.1}, "upper", "upper of overshoot must be >= 0, got -0.1"),
        ("settling_time", {"upper": -1.0}, "upper", "upper of settling_time must be >= 0 s, got -1 s"),
        ("peak", {"upper": -1.0}, "upper", "upper of peak must be >= 0, got -1"),
    ],
)  # fmt: skip
def test_a_bound_that_no_value_keeps_is_refused(metric: str, bounds: dict[str, float], key: str, says: str) -> None:
    with pytest.raises(ProblemError) as caught:
        problem(metric, **bounds)
    assert caught.value.at == ("goals", 1, key)
    assert says in caught.value.message


@pytest.mark.parametrize(
    ("metric", "bounds", "key", "says"),
    [
        ("overshoot", {"upper": 5.0}, "upper", "upper 5 of overshoot is a ratio, that is 500 %: did you mean 5 %?"),
        ("gain_margin", {"lower": 6.0}, "lower", "is a ratio, that is 15.56 dB: did you mean 6 dB?"),
        ("gain_margin", {"lower": 0.5}, "lower", "every value of gain_margin (goals compare max(g, 1/g)) is >= 1"),
        ("sensitivity_peak", {"upper": 6.0}, "upper", "did you mean 6 dB?"),
        ("phase_margin", {"upper": 60.0}, "upper", "every value of phase_margin (goals compare |φ|) is <= pi rad"),
        ("phase_margin", {"lower": 60.0, "hard": False}, "lower", "must be <= pi rad, got 60 rad: did you mean 60 deg?"),
        ("damping_ratio", {"lower": -1.0}, "lower", "every value of damping_ratio is >= -1"),
        ("rise_time", {"lower": 0.0}, "lower", "every value of rise_time is >= 0 s: this bound says nothing"),
    ],
)  # fmt: skip
def test_what_was_hardly_meant_is_told(metric: str, bounds: dict[str, float], key: str, says: str) -> None:
    (doubt,) = problem(metric, **bounds).doubts
    assert doubt.at == ("goals", 1, key)
    assert says in doubt.detail


@pytest.mark.parametrize(
    ("metric", "bounds"),
    [
        ("overshoot", {"upper": 0.05}),
        ("overshoot", {"upper": 0.0}),
        ("overshoot", {"aim": 0.005, "tolerance": 0.01}),  # its interval begins below 0
        ("gain_margin", {"lower": 2.0}),
        ("phase_margin", {"lower": math.radians(50)}),
        ("damping_ratio", {"lower": 1.0}),
        ("steady_state_error", {"lower": -0.1, "upper": 0.1}),
    ],
)
def test_what_makes_sense_is_taken_without_a_word(metric: str, bounds: dict[str, float]) -> None:
    assert problem(metric, **bounds).doubts == ()


def test_every_metric_has_a_range_and_units_that_are_known() -> None:
    for kind, metric in catalogue().items():
        assert metric.range[0] < metric.range[1], kind
        assert metric.usual_unit in {"", "deg", "%", "dB"}, kind
        assert math.isinf(metric.seldom_beyond) or metric.usual_unit in {"%", "dB"}, kind

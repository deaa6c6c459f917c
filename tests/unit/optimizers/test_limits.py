"""A limited time: the search ends before it is over, at its best point, which is measured and proven like any other."""

from __future__ import annotations

import pytest

from optimizers.methods import minimize
from optimizers.problem import Uncertain, Variable
from optimizers.search.limits import Limited
from optimizers.search.result import Status, Unwatched
from optimizers.solving.solve import compare, solve
from tests.unit.optimizers.oscillator import problem


class Clock:
    """Every look at it takes a second."""

    def __init__(self, step: float = 1.0) -> None:
        self.now, self.step = 0.0, step

    def __call__(self) -> float:
        self.now += self.step
        return self.now


def looks(limited: Limited) -> int:
    count = 0
    while not limited.cancelled():
        count += 1
    return count


def test_a_fifth_of_the_time_is_left_for_the_proof() -> None:
    assert looks(Limited(Unwatched(), 1000.0, clock=Clock())) == 799
    assert not Limited(Unwatched(), None, clock=Clock()).cancelled()


def test_a_tenth_of_the_time_is_left_for_what_follows_the_proof() -> None:
    limited = Limited(Unwatched(), 1000.0, clock=Clock())
    assert next(count for count in range(2000) if limited.hardly_left()) == 899
    assert limited.ended()
    assert not Limited(Unwatched(), None, clock=Clock()).hardly_left()
    slow = Limited(Unwatched(), 1000.0, clock=Clock(80.0))
    slow.cancelled()  # what takes 80 s to evaluate takes as long three times to describe and to draw
    assert next(count for count in range(2000) if slow.hardly_left()) == 8  # the first look after 760 s


def test_what_takes_long_to_evaluate_takes_long_to_prove() -> None:
    clock = Clock(10.0)
    limited = Limited(Unwatched(), 100.0, clock=clock)
    assert looks(limited) == 5  # 100 s less four times 10 s
    clock.step = 50.0
    assert not Limited(Unwatched(), 200.0, clock=clock).cancelled()  # a search has three tenths of its time


@pytest.mark.parametrize("kind", ["auto", "global", "gradient"])
def test_a_method_ends_with_its_best_point(kind: str) -> None:
    clock = Clock()
    limited = Limited(Unwatched(), 10.0, clock=clock)
    asked = problem(
        variables=(Variable(parameter="c", lower=0.1, upper=10.0), Variable(parameter="m", lower=0.5, upper=2.0))
    )
    found = limited.told(minimize(kind, asked, {}, monitor=limited))
    assert found.status is Status.BUDGET
    assert "the time of 10 s is used up (the search ended after 6 s, to leave time for the proof)" in found.advice
    assert len(found.certificate.goals) == 2
    assert found.goals[0].after.value is not None
    assert clock.now < 20.0


def test_a_time_that_is_over_at_once_is_the_start_measured_and_proven() -> None:
    found = solve("auto", problem(uncertain=(Uncertain(parameter="m", lower=0.5, upper=2.0),)), {}, seconds=1e-9)
    assert found.status is Status.BUDGET
    assert found.best["c"] == 1.0
    assert not found.certificate.valid
    assert "it does not meet every goal" in found.advice


def test_structures_are_compared_as_far_as_the_time_went() -> None:
    found = compare("gradient", {"one": problem(), "two": problem()}, {}, seconds=1e-9)
    assert {result.status for result in found.results.values()} == {Status.BUDGET}

"""What is put together from parts is what one process would have found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from optimizers.problem import Problem, Uncertain
from optimizers.search.result import Unwatched
from optimizers.solving import sharding
from optimizers.solving.expectation import together
from optimizers.solving.solve import solve
from tests.unit.optimizers.drive import fastest, pid_loop
from tests.unit.optimizers.landscapes import landscape

VALLEYS = landscape(
    {"f": "21 + x*x - 10*cos(2*pi*x) + y*y - 10*cos(2*pi*y)"}, {"x": (-5.0, 4.0), "y": (-4.0, 5.0)}, minimise=["f"]
)


class Given(Unwatched):
    """A monitor that has a state from elsewhere."""

    def __init__(self, state: dict[str, object]) -> None:
        self._state = state

    def keep(self, state: object) -> None:
        raise AssertionError("a grid keeps nothing")

    def kept(self) -> dict[str, object]:
        return self._state


@pytest.mark.parametrize(
    ("problem", "options"),
    [
        (VALLEYS, {"points": 11, "refine": 1}),
        (VALLEYS, {"sampling": "sobol", "samples": 128}),
        (fastest(pid_loop(), "kp", "kd"), {"points": 6}),
    ],
)
def test_a_grid_in_parts_is_the_grid(problem: Problem, options) -> None:
    whole = solve("grid", problem, options)
    count = whole.map.objective.size
    stretches = [(0, 7), (7, 8), (8, count)]
    found = [sharding.look_at(problem, options, stretch, monitor=Unwatched()) for stretch in stretches]
    joined = solve("grid", problem, options, monitor=Given(sharding.looked_at(found)))
    np.testing.assert_array_equal(joined.map.objective, whole.map.objective)
    np.testing.assert_array_equal(joined.map.violation, whole.map.violation)
    assert joined.best == whole.best
    assert joined.evaluations == whole.evaluations
    assert joined.status == whole.status
    assert [goal.after for goal in joined.goals] == [goal.after for goal in whole.goals]


def test_a_yield_in_parts_is_the_yield() -> None:
    problem = replace(
        VALLEYS, variables=VALLEYS.variables[:1], uncertain=(Uncertain(parameter="y", lower=-1, upper=1),)
    )
    problem = replace(problem, goals=(*problem.goals, replace(problem.goals[0], sense=None, upper=20.0)))
    options = {"seed": 4, "points": 3}
    whole = solve("grid", problem, options, samples=500)
    draws = [
        sharding.draw(problem, whole.best, options, stretch, samples=500, monitor=Unwatched())
        for stretch in [(0, 100), (100, 101), (101, 500)]
    ]
    assert together(draws) == whole.expected
    assert 0 < whole.expected.share < 1


def test_what_is_quick_is_not_cut() -> None:
    assert sharding.cut_grid("grid", VALLEYS, {"points": 3}) == []
    assert sharding.cut_grid("gradient", VALLEYS, {"starts": 3}) == []
    uncertain = replace(
        VALLEYS, variables=VALLEYS.variables[:1], uncertain=(Uncertain(parameter="y", lower=-1, upper=1),)
    )
    assert sharding.cut_grid("grid", uncertain, {"points": 1000}) == []
    assert sharding.cut_draws(uncertain, {"x": 1.0}, samples=10) == []


def test_parts_are_as_long_as_they_should_be_and_leave_nothing_out(monkeypatch) -> None:
    # A machine on which a point takes half a second: 81 points are 40.5 s, nine parts of 4.5 s.
    monkeypatch.setattr(sharding, "_seconds_each", lambda *_: 0.5)
    stretches = sharding.cut_grid("grid", VALLEYS, {"points": 9})
    assert len(stretches) == 9
    assert [point for first, last in stretches for point in range(first, last)] == list(range(81))
    assert len(sharding.cut_grid("grid", VALLEYS, {"points": 100})) == sharding.MOST_PARTS

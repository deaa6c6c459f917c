"""A search that was cut off goes on from its last state and ends where it would have ended."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import pytest

from optimizers.result import Share, Unwatched
from optimizers.solving import solve
from tests.unit.optimizers.landscapes import landscape

VALLEYS = landscape(
    {"f": "21 + x*x - 10*cos(2*pi*x) + y*y - 10*cos(2*pi*y)"}, {"x": (-5.0, 4.0), "y": (-4.0, 5.0)}, minimise=["f"]
)


class CutError(Exception):
    """The process dies."""


class Memory(Unwatched):
    """Keeps states as a job does, as text, and dies after ``most`` of them."""

    def __init__(self, state: str | None = None, most: int = 10**9) -> None:
        self.state = state
        self.most = most
        self.count = 0

    def keep(self, state: Mapping[str, Any]) -> None:
        self.state = json.dumps(state, allow_nan=False)
        self.count += 1
        if self.count == self.most:
            raise CutError

    def kept(self) -> Mapping[str, Any] | None:
        return None if self.state is None else json.loads(self.state)


@pytest.mark.parametrize(
    ("method", "options", "after"),
    [
        ("global", {"seed": 1, "restarts": 1}, 20),
        ("global", {"seed": 1, "restarts": 1}, 75),
        ("gradient", {"seed": 1, "starts": 4}, 2),
        ("gradient", {"seed": 1, "starts": 4}, 4),
    ],
)
def test_a_search_goes_on_where_it_was(method, options, after) -> None:
    whole = Memory()
    result = solve(method, VALLEYS, options, monitor=whole)
    assert whole.count >= after, "it must get so far"
    first = Memory(most=after)
    with pytest.raises(CutError):
        solve(method, VALLEYS, options, monitor=first)
    second = Memory(first.state)
    resumed = solve(method, VALLEYS, options, monitor=second)
    assert resumed.best == result.best
    assert resumed.objective == result.objective
    assert resumed.evaluations == result.evaluations
    assert second.count == whole.count - after


def test_searches_beside_each_other_keep_their_states_apart() -> None:
    whole = Memory()
    result = solve("gradient", VALLEYS, {"seed": 1, "starts": 2}, monitor=whole, checks=["global"])
    assert len(whole.kept()) == 2
    first = Memory(most=whole.count - 3)
    with pytest.raises(CutError):
        solve("gradient", VALLEYS, {"seed": 1, "starts": 2}, monitor=first, checks=["global"])
    second = Memory(first.state)
    resumed = solve("gradient", VALLEYS, {"seed": 1, "starts": 2}, monitor=second, checks=["global"])
    assert second.count == 3
    assert resumed.best == result.best
    assert resumed.gaps == result.gaps


def test_a_state_of_another_method_is_none() -> None:
    memory = Memory()
    Share(memory, 0.0, 0.9).keep({"kind": "global", "best": "nonsense"})
    result = solve("gradient", VALLEYS, {"seed": 1, "starts": 2}, monitor=memory)
    assert result.best == solve("gradient", VALLEYS, {"seed": 1, "starts": 2}).best

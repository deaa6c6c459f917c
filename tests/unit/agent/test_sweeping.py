"""Sweeps begin at their triggers, have all their samples, and none of them hangs on the blocks that the samples come in."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from agent.errors import AttemptError
from agent.settings import InputSettings
from agent.sweeping import preview, sweeps
from agent.triggering import Trigger, Waiting

POSITION = InputSettings(name="position", channel="Dev1/ai1", unit="mm", sensitivity=0.5, offset=1.0)
RATE = 100.0


def blocks(values: np.ndarray, size: int) -> Iterator[np.ndarray]:
    return (values[None, k : k + size] for k in range(0, values.size, size))


def whole(found: Iterator[tuple[int, np.ndarray]], samples: int) -> dict[int, np.ndarray]:
    """Return the last that is given of each sweep that became whole."""
    return {number: sweep for number, sweep in dict(found).items() if sweep.shape[1] == samples}


@pytest.mark.parametrize("size", [1, 7, 10, 30, 1000])
def test_without_a_trigger_each_begins_behind_the_one_before(size) -> None:
    values = np.arange(95.0)
    found = whole(sweeps(blocks(values, size), samples=10, waiting=lambda: None), 10)
    assert list(found) == list(range(1, 10))
    for number, sweep in found.items():
        assert np.array_equal(sweep[0], values[10 * (number - 1) : 10 * number])


@pytest.mark.parametrize("size", [1, 7, 10, 30, 1000])
def test_each_begins_before_its_trigger_and_the_next_one_is_waited_for_behind_it(size) -> None:
    """A saw tooth of 50 samples, in V; its level of 9 mm is (9 - 1) 0.5 = 4 V, which sample 20 of each tooth is the first to reach."""
    values = 0.2 * (np.arange(1000) % 50)
    level = Trigger(channel="position", when="enters", low=9.0)

    def waiting() -> Waiting:
        return Waiting(level, (POSITION,), rate=RATE, before=5)

    found = whole(sweeps(blocks(values, size), samples=40, waiting=waiting), 40)
    # One of 40 ends at 55, 5 samples of the next tooth: its trigger, 15 later, has its 5 before it.
    assert list(found) == list(range(1, 20))
    for number, sweep in found.items():
        first = 50 * (number - 1) + 15
        assert np.array_equal(sweep[0], values[first : first + 40])


def test_a_slow_one_is_given_while_it_grows() -> None:
    given = [
        (number, sweep.shape[1]) for number, sweep in sweeps(blocks(np.zeros(60), 10), samples=25, waiting=lambda: None)
    ]
    assert given == [(1, 10), (1, 20), (1, 25), (2, 5), (2, 15), (2, 25), (3, 10)]


def test_a_trigger_that_does_not_come_is_told() -> None:
    level = Trigger(channel="position", when="enters", low=9.0, timeout=0.5)
    waiting = lambda: Waiting(level, (POSITION,), rate=RATE, before=0)  # noqa: E731
    with pytest.raises(AttemptError, match=r"position must rise to 9 mm within 0\.5 s, it was between 1 and 1 mm"):
        list(sweeps(blocks(np.zeros(1000), 10), samples=10, waiting=waiting))


def test_a_preview_has_the_ends_of_each_stretch_in_the_unit_of_the_channel() -> None:
    block = np.array([[0.0, 1.0, 2.0, -1.0, 5.0]])
    told = preview((POSITION,), block, start=-0.02, rate=RATE, width=2, sweep=3)
    assert told == {"start": -0.02, "step": 0.02, "channels": {"position": [[1.0, 3.0], [-1.0, 5.0]]}, "sweep": 3}
    assert preview((POSITION,), block[:, :1], start=0.0, rate=RATE, width=2) is None

"""A clock that is set is told from one that goes on."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest

from storage.clock import TOLERANCE, WALL, JumpDetector, utc_now

NOON = datetime(2031, 5, 6, 12, 0, tzinfo=UTC)


class Clock:
    now = 50.0

    def __call__(self) -> float:
        return self.now


def test_nobody_vouches_for_a_clock_that_was_never_looked_at() -> None:
    assert not JumpDetector(clock=Clock()).steady(NOON)


@pytest.mark.parametrize("passed", [0.0, 1.0, 7200.0])
def test_a_clock_that_goes_on_as_time_does_is_steady(passed: float) -> None:
    clock = Clock()
    detector = JumpDetector(clock=clock)
    detector.note(NOON)
    clock.now += passed
    assert detector.steady(NOON + timedelta(seconds=passed))
    assert detector.steady(NOON + timedelta(seconds=passed + 0.9 * TOLERANCE))


@pytest.mark.parametrize("jump", [3600.0, -3600.0, 2 * TOLERANCE, -2 * TOLERANCE])
def test_a_jump_is_noticed_until_it_is_noted(jump: float) -> None:
    clock = Clock()
    detector = JumpDetector(clock=clock)
    detector.note(NOON)
    clock.now += 10.0
    then = NOON + timedelta(seconds=10.0 + jump)
    assert not detector.steady(then)
    assert not detector.steady(then)
    detector.note(then)
    assert detector.steady(then)


def test_the_wall_clock_is_that_of_the_machine() -> None:
    assert timedelta(0) == WALL.ahead
    before = datetime.now(UTC)
    assert before <= utc_now() <= datetime.now(UTC)

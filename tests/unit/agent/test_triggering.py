"""A trigger is found at its sample, whatever blocks the samples come in, and what was before it is there."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from agent.errors import AttemptError
from agent.settings import InputSettings
from agent.triggering import Search, Trigger, Waiting

INF, NAN = math.inf, math.nan
POSITION = InputSettings(name="position", channel="Dev1/ai1", unit="mm", sensitivity=0.5, offset=1.0)
OTHER = InputSettings(name="other", channel="Dev1/ai0")


def level(value: float, edge: str = "rising", **more: float) -> Trigger:
    ends = {"low": value} if edge == "rising" else {"high": value}
    return Trigger(channel="position", when="enters", **ends, **more)


def window(low: float, high: float, when: str, **more: float) -> Trigger:
    return Trigger(channel="position", when=when, low=low, high=high, **more)


def found(trigger: Trigger, values: list[float], *, first: int = 0, block: int = 1000) -> int | None:
    """Search block after block, to the first one in which it is."""
    search = Search(trigger, first=first)
    for start in range(0, len(values), block):
        at = search.find(np.array(values[start : start + block], dtype=float))
        if at is not None:
            return at
    return None


def expected(trigger: Trigger, values: list[float], first: int) -> int | None:
    """Do the same as a person would, one sample after the other."""
    low, high, h = trigger.low, trigger.high, trigger.hysteresis
    armed = False
    for k, x in enumerate(values):
        if trigger.when == "enters":
            arms, fires = x < low - h or x > high + h, low <= x <= high
        else:
            arms, fires = low + h <= x <= high - h, x < low or x > high
        if fires and armed and k >= first:
            return k
        armed = True if arms else False if fires else armed
    return None


@pytest.mark.parametrize(
    ("trigger", "values", "at"),
    [
        (level(1), [0, 0.5, 1, 2], 2),  # the level itself counts
        (level(1), [2, 3, 4], None),  # above from the start: no edge
        (level(1), [2, 0, 2], 2),
        (level(1, hysteresis=0.5), [0.6, 1.2, 0.6, 1.2], None),  # noise around the level
        (level(1, hysteresis=0.5), [0.4, 0.7, 1.2], 2),  # between the two it stays armed
        (level(1, hysteresis=0.5), [0.5, 1.2, 0.4, 1.2], 3),
        (level(1), [0, NAN, INF], 2),
        (level(1), [NAN, 2], None),
        (level(-1, "falling"), [0, -0.5, -1], 2),
        (level(-1, "falling"), [-2, -3], None),
        (level(-1, "falling", hysteresis=0.5), [-0.6, -1, -0.4, -1], 3),
        (window(1, 2, "enters"), [0, 3, 0, 1.5], 3),  # a sample beyond it has not entered
        (window(1, 2, "enters"), [3, 2], 1),
        (window(1, 2, "enters"), [1.5, 1.6], None),
        (window(1, 2, "enters", hysteresis=0.5), [2.4, 2, 2.6, 2], 3),
        (window(1, 2, "leaves"), [3, 1, 2.1], 2),
        (window(1, 2, "leaves"), [1.5, 0.9], 1),
        (window(1, 2, "leaves", hysteresis=0.2), [1.1, 0.9, 1.2, 0.9], 3),
        (window(1, 2, "leaves"), [0, 3, 0], None),
    ],
)
@pytest.mark.parametrize("block", [1, 2, 100])
def test_the_trigger_is_the_sample_that_fires(trigger, values, at, block) -> None:
    assert found(trigger, values, block=block) == at


def test_a_trigger_before_its_time_passes_and_the_next_one_counts() -> None:
    values = [0, 2, 2, 0, 2]
    assert found(level(1), values, first=1) == 1
    assert found(level(1), values, first=2) == 4  # at sample 2 it is above already
    assert found(level(1), values[:4], first=2) is None


NUMBERS = st.one_of(st.integers(-6, 6).map(lambda k: k / 2), st.just(NAN), st.just(INF), st.just(-INF))
TRIGGERS = st.builds(
    lambda low, width, h, kind: (
        level(low, kind, hysteresis=h) if kind in {"rising", "falling"} else window(low, low + width + 2 * h, kind, hysteresis=h)
    ),
    st.integers(-4, 4).map(lambda k: k / 2),
    st.integers(1, 4).map(lambda k: k / 2),
    st.integers(0, 3).map(lambda k: k / 2),
    st.sampled_from(["rising", "falling", "enters", "leaves"]),
)  # fmt: skip


@given(trigger=TRIGGERS, values=st.lists(NUMBERS, max_size=60), first=st.integers(0, 30), block=st.integers(1, 70))
def test_blocks_are_searched_as_the_whole_is(trigger, values, first, block) -> None:
    assert found(trigger, values, first=first, block=block) == expected(trigger, values, first)


def recorded(values: np.ndarray, trigger: Trigger, *, before: int, length: int, cuts: list[int]) -> np.ndarray:
    """Return what an agent would record, of blocks that end at some samples."""
    waiting = Waiting(trigger, [OTHER, POSITION], rate=10.0, before=before)
    blocks = iter(np.split(values, cuts, axis=1))
    while not waiting.take(next(blocks)):
        kept = sum(block.shape[1] for block in waiting.recorded())
        assert kept <= before + max(np.diff([0, *cuts, values.shape[1]]))  # of what has passed no more is kept
    return np.concatenate([*waiting.recorded(), *blocks], axis=1)[:, : before + length]


@given(
    at=st.integers(1, 80), before=st.integers(0, 60), cuts=st.sets(st.integers(1, 99), max_size=40).map(sorted)
)  # fmt: skip
@example(at=40, before=40, cuts=[40])  # between two blocks, with exactly what is to be before it
@example(at=40, before=30, cuts=list(range(1, 99)))  # longer than many blocks
def test_the_recording_is_what_was_before_and_after(at, before, cuts) -> None:
    at = max(at, before)
    position = np.where(np.arange(100) < at, 0.0, 2.0)
    values = np.stack([np.arange(100.0), position])
    # 2 V are 2 / 0.5 + 1 = 5 mm, 0 V are 1 mm.
    got = recorded(values, level(4.9), before=before, length=20, cuts=cuts)
    assert got[0].tolist() == list(range(at - before, at + 20))


def test_where_no_trigger_comes_it_is_said_what_was_seen_instead() -> None:
    waiting = Waiting(level(7, hysteresis=0.5, timeout=3.0), [OTHER, POSITION], rate=10.0, before=5)
    assert waiting.most == 35
    assert not waiting.take(np.stack([np.zeros(34), np.linspace(-0.5, 2.0, 34)]))
    with pytest.raises(AttemptError) as caught:
        waiting.take(np.stack([np.zeros(4), np.full(4, NAN)]))
    assert caught.value.code == "no_trigger"
    assert caught.value.detail == (
        "position must rise to 7 mm with a hysteresis of 0.5 mm within 3 s, it was between 0 and 5 mm "
        "- take a level that is reached, or a longer timeout"
    )


def test_a_trigger_after_the_time_is_none() -> None:
    waiting = Waiting(level(4.9, timeout=3.0), [OTHER, POSITION], rate=10.0, before=0)
    late = np.stack([np.zeros(40), np.where(np.arange(40) < 30, 0.0, 2.0)])
    with pytest.raises(AttemptError, match="within 3 s"):
        waiting.take(late)
    waiting = Waiting(level(4.9, timeout=3.0), [OTHER, POSITION], rate=10.0, before=0)
    assert waiting.take(late[:, 1:])
    assert waiting.at == 29


@pytest.mark.parametrize(
    ("trigger", "says"),
    [
        (level(2), "rise to 2 mm"),
        (level(-2, "falling"), "fall to -2 mm"),
        (window(1, 3, "enters"), "enter 1 ... 3 mm"),
        (window(1, 3, "leaves", hysteresis=0.1), "leave 1 ... 3 mm with a hysteresis of 0.1 mm"),
    ],
)
def test_it_says_what_is_waited_for(trigger, says) -> None:
    assert trigger.words("mm") == says


def test_levels_are_in_the_unit_that_the_channel_still_has() -> None:
    told = {
        "channel": "position",
        "unit": "mm",
        "when": "enters",
        "low": 2.0,
        "high": None,
        "hysteresis": 0.0,
        "timeout": 9.0,
    }
    assert Trigger.of(told, [OTHER, POSITION]) == level(2.0, timeout=9.0)
    with pytest.raises(AttemptError, match="unit of position must be cm, as when it was asked for, got mm"):
        Trigger.of(told | {"unit": "cm"}, [OTHER, POSITION])

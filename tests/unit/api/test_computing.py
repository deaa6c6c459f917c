"""A request computes for a bounded time, and ends when nobody waits for it."""

from __future__ import annotations

import asyncio
import importlib
import sys
import threading
import time
import weakref
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from api.problems.documents import Problem
from api.problems.exceptions import RecalledError
from api.services.jobs.computing import Computing, LargeError, Recall
from api.settings import Settings


def computing(**settings) -> Computing:
    return Computing(Settings(**settings))


def busy(seconds: float) -> int:
    """Compute, as the numerics do: many short compiled calls."""
    until = time.monotonic() + seconds
    rounds = 0
    while time.monotonic() < until:
        np.linalg.eigvals(np.ones((5, 5)))
        rounds += 1
    return rounds


def test_what_is_in_time_passes() -> None:
    with computing(request_seconds=5).slot():
        rounds = busy(0.05)
    assert rounds > 0


def test_what_takes_too_long_is_stopped_and_says_so() -> None:
    slots = computing(request_seconds=0.2)
    began = time.monotonic()
    with pytest.raises(Problem, match=r"within 0\.2 s") as caught, slots.slot():
        busy(30)
    assert time.monotonic() - began < 5
    assert caught.value.status == 422
    with slots.slot():  # nothing is raised later
        busy(0.05)
    time.sleep(0.3)


LOADED_LATE = """
from gate_of_loaded_late import recalled, reached
reached.set()
recalled.wait()
sum(number for number in range(100_000))
complete = True
"""


def test_an_import_is_never_left_half_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first request that needs a library loads it; were it stopped there, the library would fail for everybody."""
    (tmp_path / "loaded_late.py").write_text(LOADED_LATE)
    monkeypatch.syspath_prepend(tmp_path)
    gate = SimpleNamespace(reached=threading.Event(), recalled=threading.Event())
    monkeypatch.setitem(sys.modules, "gate_of_loaded_late", gate)
    slots, recall = computing(request_seconds=30), Recall()
    loaded: list[bool] = []

    def work() -> None:
        with slots.slot():
            loaded.append(importlib.import_module("loaded_late").complete)
            busy(30)

    def ask() -> None:
        gate.reached.wait()
        recall.ask()
        gate.recalled.set()

    threading.Thread(target=ask).start()
    with pytest.raises(RecalledError):
        in_thread(slots, work, recall)
    assert loaded == [True]


class Timer:
    """A timer of threading that goes off when the test says so."""

    started: ClassVar[list[Timer]] = []

    def __init__(self, seconds: float, work: Callable[[], None]) -> None:
        self.go_off, self.daemon = work, False

    def start(self) -> None:
        self.started.append(self)

    def cancel(self) -> None:
        if self in self.started:
            self.started.remove(self)


def test_an_alarm_that_a_callback_has_dropped_goes_off_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The interpreter drops what is raised in a callback of a weak reference: the computation had no limit then."""
    monkeypatch.setattr("api.services.jobs.computing.threading.Timer", Timer)
    monkeypatch.setattr(Timer, "started", [])
    slots, passed = computing(), []

    class Thing:
        pass

    def drop(_: object) -> None:
        (alarm,) = Timer.started
        alarm.go_off()
        passed.append("callback")

    def work() -> None:
        thing = Thing()
        reference = weakref.ref(thing, drop)
        del thing  # the alarm ends the callback, and nobody hears of it
        assert reference() is None
        (again,) = Timer.started
        again.go_off()
        passed.append("computation")

    with pytest.raises(Problem, match="must be computed within"), slots.slot():
        work()
    assert passed == []
    assert Timer.started == []


def test_an_alarm_never_goes_off_after_the_computation() -> None:
    slots = computing(request_seconds=0.01)
    stopped = 0
    for _ in range(200):
        try:
            with slots.slot():
                busy(0.0099)
        except Problem:
            stopped += 1
        sum(range(1000))
    assert stopped <= 200


def in_thread(slots: Computing, work, recall: Recall, *, lane: str = "threads"):
    return asyncio.run(slots.in_thread(getattr(slots, lane), "ws", "key", work, recall=recall))


def test_what_nobody_waits_for_any_more_is_ended() -> None:
    slots, recall, began = computing(request_seconds=30), Recall(), threading.Event()

    def work() -> None:
        with slots.slot():
            began.set()
            busy(30)

    threading.Thread(target=lambda: began.wait() and recall.ask()).start()
    with pytest.raises(RecalledError):
        in_thread(slots, work, recall)


def test_what_was_recalled_before_does_not_begin() -> None:
    slots, recall = computing(request_seconds=30), Recall()

    def work() -> None:
        with slots.slot():
            busy(30)

    recall.ask()
    with pytest.raises(RecalledError):
        in_thread(slots, work, recall)


def test_a_recall_that_comes_too_late_is_none() -> None:
    slots, recall = computing(), Recall()

    def work() -> int:
        with slots.slot():
            busy(0.01)
        recall.ask()
        return busy(0.05)

    assert in_thread(slots, work, recall) > 0


@pytest.mark.parametrize("cost", [0.0, 30.0])
def test_what_is_not_quick_leaves_the_lane_of_what_is(cost) -> None:
    slots, begun = computing(quick_seconds=0.1, request_seconds=30), []

    def work() -> None:
        with slots.slot(cost):
            begun.append(cost)
            busy(30)

    with pytest.raises(LargeError):
        in_thread(slots, work, Recall(), lane="quick")
    assert begun == ([] if cost else [0.0])  # what is expected to be large does not even begin


@pytest.mark.parametrize(
    ("size", "says"),
    [
        ({"samples": 11, "curves": 1, "variants": 1}, "samples must be <= 10, got 11"),
        ({"samples": 10, "curves": 1, "variants": 6}, "variants must be <= 5, got 6"),
        ({"samples": 10, "curves": 100, "variants": 5}, "must be <= 1000, got 10 x 100 x 5 = 5000"),
    ],
)
def test_a_reply_that_would_be_too_large_names_count_and_limit(size, says) -> None:
    with pytest.raises(Problem, match=says):
        computing(max_samples=10, max_variants=5, max_numbers=1000).check_size(**size)

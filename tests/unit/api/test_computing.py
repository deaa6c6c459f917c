"""A request computes for a bounded time, and ends when nobody waits for it."""

from __future__ import annotations

import asyncio
import importlib
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar
from unittest.mock import MagicMock

import numpy as np
import pytest

from api.problems.documents import Problem
from api.problems.exceptions import RecalledError
from api.processes.large_request import unhurried
from api.services.jobs.computing import Computing, LargeError, Recall
from api.services.operation.app_context import Installation
from api.settings import Settings
from storage.jobs.compute import ComputeJob


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
    assert computing(request_seconds=5).bounded(lambda: busy(0.05)) > 0


def test_what_takes_too_long_is_stopped_and_says_so() -> None:
    slots = computing(request_seconds=0.2)
    began = time.monotonic()
    with pytest.raises(Problem, match=r"within 0\.2 s") as caught:
        slots.bounded(lambda: busy(30))
    assert time.monotonic() - began < 5
    assert caught.value.status == 422
    slots.bounded(lambda: busy(0.05))  # nothing is raised later
    time.sleep(0.3)


def test_what_a_busy_machine_lets_a_process_wait_is_no_computing_of_its_own() -> None:
    """A simulation that ends after 30 s of computing, with advice, was refused without any after 60 s on the clock."""
    hurried: Any = Installation(
        settings=Settings(request_seconds=0.01), database=MagicMock(), queue=MagicMock(), computing=MagicMock()
    )
    assert unhurried(hurried).computing.bounded(lambda: busy(0.1)) > 0


def test_who_asks_for_too_much_reads_what_bounds_a_simulation() -> None:
    with pytest.raises(Problem, match="`duration`"):
        computing(request_seconds=0.01).bounded(lambda: busy(30))


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

    def compute() -> None:
        loaded.append(importlib.import_module("loaded_late").complete)
        busy(30)

    def ask() -> None:
        gate.reached.wait()
        recall.ask()
        gate.recalled.set()

    threading.Thread(target=ask).start()
    with pytest.raises(RecalledError):
        in_thread(slots, partial(slots.bounded, compute), recall)
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

    def compute() -> None:
        thing = Thing()
        reference = weakref.ref(thing, drop)
        del thing  # the alarm ends the callback, and nobody hears of it
        assert reference() is None
        (again,) = Timer.started
        again.go_off()
        passed.append("computation")

    with pytest.raises(Problem, match="must be computed within"):
        slots.bounded(compute)
    assert passed == []
    assert Timer.started == []


def _going_off_at(place: int, slots: Computing) -> tuple[bool, object]:
    """Return whether a computation has a place of that number at which the interpreter may raise, and how it ends
    when its alarm goes off there.

    The interpreter raises what another thread asks for as a function begins and as a compiled one returns.
    """
    wished, gone_off = threading.Lock(), threading.Lock()
    wished.acquire()
    gone_off.acquire()
    places = 0

    def go_off() -> None:
        with wished:
            for timer in Timer.started[:1]:
                timer.go_off()
            gone_off.release()

    def profile(_frame: object, event: str, _function: object) -> None:
        nonlocal places
        if Timer.started and event in {"call", "c_return"}:
            places += 1
            if places == place:
                wished.release()
                gone_off.acquire()

    threading.Thread(target=go_off, daemon=True).start()
    ended: object = None
    sys.setprofile(profile)
    try:
        ended = slots.bounded(lambda: len("computed"))
    except BaseException as error:  # noqa: BLE001 - whatever it is
        ended = type(error)
    finally:
        sys.setprofile(None)
    if places < place:
        wished.release()
    return places >= place, ended


def test_an_alarm_ends_the_computation_wherever_it_goes_off_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that went off as the computation ended went off again twice a second for ever, in what the thread did next."""
    monkeypatch.setattr("api.services.jobs.computing.threading.Timer", Timer)
    monkeypatch.setattr(Timer, "started", [])
    slots, ends = computing(), []
    for place in range(1, 1000):
        exists, ended = _going_off_at(place, slots)
        assert Timer.started == [], f"still counting after {place}"
        if not exists:
            break
        ends.append(ended)
    assert len(ends) > 3
    assert set(ends) <= {Problem, len("computed")}
    assert Problem in ends


def test_an_alarm_never_goes_off_after_the_computation() -> None:
    slots = computing(request_seconds=0.01)
    stopped = 0
    for _ in range(200):
        try:
            slots.bounded(lambda: busy(0.0099))
        except Problem:
            stopped += 1
        sum(range(1000))
    assert stopped <= 200


def in_thread(slots: Computing, work, recall: Recall, *, lane: str = "threads"):
    return asyncio.run(slots.in_thread(getattr(slots, lane), "ws", "key", work, recall=recall))


def test_what_nobody_waits_for_any_more_is_ended() -> None:
    slots, recall, began = computing(request_seconds=30), Recall(), threading.Event()

    def compute() -> None:
        began.set()
        busy(30)

    threading.Thread(target=lambda: began.wait() and recall.ask()).start()
    with pytest.raises(RecalledError):
        in_thread(slots, partial(slots.bounded, compute), recall)


def test_what_was_recalled_before_does_not_begin() -> None:
    slots, recall = computing(request_seconds=30), Recall()
    recall.ask()
    with pytest.raises(RecalledError):
        in_thread(slots, partial(slots.bounded, lambda: busy(30)), recall)


def test_a_recall_that_comes_too_late_is_none() -> None:
    slots, recall = computing(), Recall()

    def work() -> int:
        slots.bounded(lambda: busy(0.01))
        recall.ask()
        return busy(0.05)

    assert in_thread(slots, work, recall) > 0


@pytest.mark.parametrize("cost", [0.0, 30.0])
def test_what_is_not_quick_leaves_the_lane_of_what_is(cost) -> None:
    slots, begun = computing(quick_seconds=0.1, request_seconds=30), []

    def compute() -> None:
        begun.append(cost)
        busy(30)

    with pytest.raises(LargeError):
        in_thread(slots, partial(slots.bounded, compute, cost), Recall(), lane="quick")
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


@pytest.fixture
def apart(monkeypatch) -> Iterator[Callable[[str], Mapping[str, Any]]]:
    """Compute in a process of its own, for at most a second."""
    monkeypatch.setattr("api.services.jobs.computing.CHILD", "tests.support.bounded:run")
    slots = computing(request_seconds=1)

    def compute(kind: str) -> Mapping[str, Any]:
        job = ComputeJob(id="req_1", kind=kind, body={"seconds": 1.0}, workspace_id="ws", database_url="sqlite://")
        return asyncio.run(slots.in_child(job, "key", recall=Recall()))

    yield compute
    slots.close()


def test_a_process_may_wait_longer_than_it_may_compute(apart) -> None:
    assert apart("waiting") == {"done": "waiting"}


def test_a_process_that_computes_too_long_is_ended_and_says_so(apart) -> None:
    with pytest.raises(Problem, match="must be computed within 1 s") as caught:
        apart("computing")
    assert (caught.value.status, caught.value.kind) == (422, "too-long")

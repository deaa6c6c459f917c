"""A request computes for a bounded time, and not more of them at once than there are slots."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from api.problems import Problem
from api.services.computing import Computing, Recall, RecalledError
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
    slots = computing(request_seconds=0.2, compute_slots=1)
    began = time.monotonic()
    with pytest.raises(Problem, match=r"within 0\.2 s") as caught, slots.slot():
        busy(30)
    assert time.monotonic() - began < 5
    assert caught.value.status == 422
    with slots.slot():  # the slot is free again, and nothing is raised later
        busy(0.05)
    time.sleep(0.3)


def test_an_alarm_never_goes_off_after_the_computation() -> None:
    slots = computing(request_seconds=0.01, compute_slots=1)
    stopped = 0
    for _ in range(200):
        try:
            with slots.slot():
                busy(0.0099)
        except Problem:
            stopped += 1
        sum(range(1000))
    assert stopped <= 200


def test_what_nobody_waits_for_any_more_is_ended_and_its_slot_is_free() -> None:
    slots, recall = computing(request_seconds=30, compute_slots=1), Recall()
    began = time.monotonic()
    threading.Timer(0.1, recall.ask).start()
    with pytest.raises(RecalledError), slots.slot(recall):
        busy(30)
    assert time.monotonic() - began < 5
    with slots.slot():
        busy(0.05)


def test_what_was_recalled_before_does_not_begin() -> None:
    recall = Recall()
    recall.ask()
    with pytest.raises(RecalledError), computing(request_seconds=30).slot(recall):
        busy(30)


def test_a_recall_that_comes_too_late_is_none() -> None:
    slots, recall = computing(compute_slots=1), Recall()
    with slots.slot(recall):
        busy(0.01)
    recall.ask()
    busy(0.05)


def test_a_taken_slot_is_waited_for_and_then_refused() -> None:
    slots = computing(request_seconds=0.3, compute_slots=1)
    inside, leave = threading.Event(), threading.Event()

    def hold() -> None:
        with slots.slot():
            inside.set()
            leave.wait(0.1)

    thread = threading.Thread(target=hold)
    thread.start()
    inside.wait()
    with slots.slot():  # as soon as the other one has left
        leave.set()
    thread.join()


def test_a_slot_that_stays_taken_is_a_503() -> None:
    slots = computing(request_seconds=0.2, compute_slots=1)
    assert slots._slots.acquire()
    with pytest.raises(Problem) as caught, slots.slot():
        pass
    assert caught.value.status == 503
    assert caught.value.headers["Retry-After"]


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

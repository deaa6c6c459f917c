"""Candidates that others compute: who is asked, for how much, and what becomes of what does not come back."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.model.interruption import interruptible
from optimizers.evaluation.evaluate import Assessment, Evaluator, Matrix
from optimizers.evaluation.spreading import Provider, Workers, spread
from optimizers.identification import identify
from optimizers.search.blocks import in_blocks
from optimizers.search.result import Status, Unwatched
from optimizers.search.search import Tracker
from optimizers.solving.solve import solve
from tests.unit.optimizers.drive import fastest, pd2_loop, pid_loop
from tests.unit.optimizers.landscapes import landscape
from tests.unit.optimizers.test_kept_states import DELAYED, Memory

BOWL = landscape({"f": "1 + x*x + y*y"}, {"x": (-2.0, 2.0), "y": (-2.0, 2.0)}, minimise=["f"])
LATE = fastest(pd2_loop(), "kp", "kd1")
SHARP = fastest(pid_loop(delay=0.0), "kp", "ki", "kd", scenarios=({}, {"lag": 0.0012}))
EAGER = {"search": 0.0, "call": 0.0, "chunk": 1e-9}


class Own(Executor):
    """Workers of the test behind the seam, each chunk handed to a function that may do with it what it likes."""

    def __init__(self, count: int, before: Callable[[], None] = lambda: None) -> None:
        self.pool, self.count, self.before = ThreadPoolExecutor(count), count, before
        self.submitted = self.losses = 0

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.submitted += 1

        def work() -> Any:
            self.before()
            return fn(*args, **kwargs)

        return self.pool.submit(work)

    def open(self) -> Workers:
        return Workers(executor=self, count=self.count, threaded=False)

    def lost(self) -> None:
        self.losses += 1

    def close(self) -> None:
        self.pool.shutdown(wait=False, cancel_futures=True)


def assessed(provider: Provider, problem: Any, positions: Matrix, **seconds: float) -> Assessment:
    with spread(provider, **{**EAGER, **seconds}):
        evaluator = Evaluator(problem)
        evaluator.seconds_each = 1.0
        return evaluator.assess(positions)


def same(one: Assessment, other: Assessment) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
        for name in ("objective", "violation", "values", "doubtful")
    )


@pytest.mark.parametrize("problem", [BOWL, LATE, SHARP], ids=["kernels", "delays", "scenarios"])
def test_numbers_are_the_same_to_the_bit_wherever_a_call_is_cut(problem) -> None:
    positions = np.random.default_rng(3).random((300, len(problem.axes)))
    whole = Evaluator(problem).assess(positions)
    made = Own(3)
    assert same(assessed(made, problem, positions), whole)
    together = Evaluator(problem).together
    assert made.submitted == -(-300 // together)
    # On one thread as on many, and without the last ones.
    alone = Evaluator(problem, threads=1).assess(positions[: 2 * together])
    assert np.array_equal(alone.values, whole.values[: 2 * together], equal_nan=True)


def test_eight_workers_compute_at_the_same_time() -> None:
    # Nobody passes before eight have come: sixteen chunks are two rounds, and of seven workers none would end.
    barrier = threading.Barrier(8)
    made = Own(8, lambda: barrier.wait(60) and None)
    positions = np.random.default_rng(0).random((16 * 128, 2))
    found = assessed(made, BOWL, positions)
    assert made.submitted == 16
    assert made.losses == 0
    assert same(found, Evaluator(BOWL).assess(positions))


def test_chunks_are_longer_where_more_workers_have_to_be_served() -> None:
    made = Own(2)
    for count, seconds in ((2, 0.5), (100, 0.5), (1000, 5.0)):
        made.count = count
        with spread(made, search=0.0) as over:
            evaluator = Evaluator(BOWL)
            evaluator.seconds_each = 1e-3
            call = over.fitting(evaluator, 10**8)
        assert call is not None
        assert call / (4 * count) * 1e-3 == pytest.approx(seconds, abs=0.128)


def test_a_small_search_never_leaves_the_process() -> None:
    made = Own(2)
    with spread(made) as over:
        solve("grid", BOWL, {"points": 5})
    assert (made.submitted, over.sent, over.left) == (0, 0, 0)


@pytest.mark.parametrize("seconds", [1e-4, 1.0], ids=["quick", "slow"])
def test_blocks_are_as_large_as_others_can_take(monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    # A candidate that takes long makes small blocks here, each a single neighbourhood, which nobody could share.
    made, positions = Own(2), np.random.default_rng(0).random((1024, 2))
    alone = [found for _, found in in_blocks(Tracker(Evaluator(BOWL), Unwatched(), 10**6), positions)]
    monkeypatch.setattr(Evaluator, "seconds_each", property(lambda _: seconds, lambda *_: None), raising=False)
    with spread(made, **EAGER) as over:
        found = [found for _, found in in_blocks(Tracker(Evaluator(BOWL), Unwatched(), 10**6), positions)]
    assert over.sent == 8
    assert len(found) == 1
    assert np.array_equal(found[0].values, np.concatenate([one.values for one in alone]))


def test_what_fails_elsewhere_is_computed_here() -> None:
    turns = iter(range(100))

    def fail() -> None:
        if next(turns) % 2:
            raise MemoryError

    made = Own(1, fail)
    positions = np.random.default_rng(0).random((4 * 128, 2))
    assert same(assessed(made, BOWL, positions), Evaluator(BOWL).assess(positions))
    assert made.losses == 1


def test_nobody_who_is_silent_is_waited_for() -> None:
    silent = threading.Event()
    made = Own(1, lambda: silent.wait() and None)
    positions = np.random.default_rng(0).random((2 * 128, 2))
    try:
        with spread(made, **EAGER, patience=0.0):
            evaluator = Evaluator(BOWL)
            evaluator.seconds_each = 1e-6
            assert same(evaluator.assess(positions), Evaluator(BOWL).assess(positions))
    finally:
        silent.set()
    assert made.losses == 1


def test_a_cancel_is_heard_while_others_compute() -> None:
    silent = threading.Event()

    class Enough(Exception):  # noqa: N818
        pass

    def ask() -> None:
        raise Enough

    made = Own(1, lambda: silent.wait() and None)
    try:
        with pytest.raises(Enough), interruptible(ask):
            assessed(made, BOWL, np.zeros((2 * 128, 2)))
    finally:
        silent.set()


@pytest.mark.parametrize("fails", [False, True])
def test_starts_of_an_identification_are_followed_by_others(fails: bool) -> None:
    turns = iter(range(100))

    def maybe_fail() -> None:
        if fails and next(turns) % 2:
            raise MemoryError

    alone = identify(DELAYED, rng=np.random.default_rng(0))
    made, watch = Own(2, maybe_fail), Memory()
    with spread(made, **EAGER) as over:
        together = identify(DELAYED, rng=np.random.default_rng(0), monitor=watch)
    assert (over.sent, over.left) == ((3, 2) if fails else (5, 0))
    # A response remembers how long the one before took to settle: that much, rounding, depends on who follows a start.
    found, wanted = together.parameters["transport.time"].value, alone.parameters["transport.time"].value
    assert found == pytest.approx(wanted, rel=1e-12)
    assert together.evaluations == pytest.approx(alone.evaluations, abs=2)
    assert together.status == alone.status
    # One start after the other is done, whoever was first.
    assert [state["start"] for state in watch.states if state["here"] is None] == [1, 2, 3, 4, 5, 6]


def test_a_cancel_is_heard_while_others_follow_starts() -> None:
    silent = threading.Event()

    class Cancelled(Memory):
        def cancelled(self) -> bool:
            return made.submitted > 0

    made = Own(1, lambda: silent.wait() and None)
    try:
        with spread(made, **EAGER):
            found = identify(DELAYED, rng=np.random.default_rng(0), monitor=Cancelled())
    finally:
        silent.set()
    assert found.status is Status.CANCELLED


PROCESSES = """
import os, signal
import numpy as np
from optimizers.evaluation.evaluate import Evaluator
from optimizers.evaluation.processes import Processes
from optimizers.evaluation.spreading import spread
from tests.unit.optimizers.test_spreading import EAGER, LATE, same

positions = np.random.default_rng(3).random((96, 2))
whole = Evaluator(LATE).assess(positions)
here = Processes(2)
with spread(here, **EAGER) as over:
    evaluator = Evaluator(LATE)
    evaluator.seconds_each = 1.0
    assert same(evaluator.assess(positions), whole)
    assert (over.sent, over.left) == (3, 0)
    first = here.open().executor
    os.kill(next(iter(first._processes)), signal.SIGKILL)
    evaluator.seconds_each = 1.0
    assert same(evaluator.assess(positions), whole)
    # What the killed one had is computed here, or by others where the kill came too late for that call.
    evaluator.seconds_each = 1.0
    assert same(evaluator.assess(positions), whole)
    assert over.left > 0
    assert here.open().executor is not first
print("done")
"""


def test_processes_of_this_machine_are_the_workers_otherwise() -> None:
    root = Path(__file__).parents[3]
    done = subprocess.run([sys.executable, "-c", PROCESSES], cwd=root, capture_output=True, text=True, check=False)
    assert done.stdout == "done\n", done.stderr

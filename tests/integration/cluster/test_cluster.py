"""Searches over a real cluster: the numbers of one process to the bit, whoever dies meanwhile."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from api.processes.cluster import Cluster
from engine.model.interruption import interruptible
from optimizers.evaluation import spreading
from optimizers.evaluation.evaluate import Evaluator
from optimizers.evaluation.processes import Processes
from optimizers.evaluation.spreading import Spread, spread
from optimizers.identification import identify
from optimizers.problem import Problem, Uncertain
from optimizers.search.result import Result
from optimizers.solving.solve import solve
from tests.integration.cluster.conftest import DaskCluster
from tests.support.desk import wait_for
from tests.support.patience import PATIENCE
from tests.unit.optimizers.drive import fastest, pid_loop
from tests.unit.optimizers.landscapes import landscape
from tests.unit.optimizers.test_kept_states import DELAYED

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")

VALLEYS = landscape(
    {"f": "21 + x*x - 10*cos(2*pi*x) + y*y - 10*cos(2*pi*y)", "g": "1 + (x - 1)**2 + (y - 2)**2"},
    {"x": (-5.0, 4.0), "y": (-4.0, 5.0)},
    minimise=["f"],
    limits={"g": 30.0},
)
FRONT = landscape(
    {"f": "1 + x*x + y*y", "g": "1 + (x - 1)**2 + (y - 1)**2"},
    {"x": (-2.0, 2.0), "y": (-2.0, 2.0)},
    minimise=["f", "g"],
)
UNSURE = replace(
    fastest(pid_loop(), "kp", scenarios=({},)), uncertain=(Uncertain(parameter="delay", lower=0.003, upper=0.005),)
)  # fmt: skip
#: Everything leaves the process that can, in small chunks.
EAGER = {"search": 0.0, "call": 0.0, "chunk": 1e-3}


@contextmanager
def over(cluster: DaskCluster, **seconds: float) -> Iterator[tuple[Spread, Cluster]]:
    workers = Cluster(cluster.address, security=cluster.files, adaptive=0, here=Processes(1))
    with spread(workers, **{**EAGER, "patience": 60.0, **seconds}) as made:
        wait_for(lambda: (found := workers.open()) is not None and found.count > 0, "workers")
        yield made, workers


def plain(result: Result) -> str:
    """Everything that a search found to the last bit, without the time that it took."""
    told: dict[str, Any] = {
        name: getattr(result, name)
        for name in ("status", "advice", "best", "evaluations", "warnings", "front", "robustness", "expected", "moves")
    }
    told["objective"] = result.objective
    told["history"] = [(p.evaluation, p.objective, p.violation, dict(p.variables)) for p in result.history]
    told["goals"] = [goal.after for goal in result.goals]
    if result.map is not None:
        told["map"] = (result.map.objective.tobytes(), result.map.violation.tobytes())
    return repr(told)


@pytest.mark.parametrize(
    ("kind", "problem", "options"),
    [
        ("grid", VALLEYS, {"points": 40, "refine": 1}),
        ("grid", VALLEYS, {"sampling": "sobol", "samples": 700}),
        ("global", VALLEYS, {"population": 300, "restarts": 0, "max_evaluations": 1500}),
        ("gradient", VALLEYS, {"starts": 2}),
        ("pareto", FRONT, {"population": 260, "generations": 3, "points": 4}),
        ("grid", UNSURE, {"points": 3}),  # the adversary is spread
    ],
)
def test_a_search_finds_the_same_to_the_bit(cluster: DaskCluster, kind: str, problem: Problem, options) -> None:
    alone = solve(kind, problem, options)
    with over(cluster) as (made, _):
        together = solve(kind, problem, options)
    assert made.sent > 0
    assert made.left == 0
    assert plain(together) == plain(alone)


def test_starts_of_an_identification_end_at_the_same(cluster: DaskCluster) -> None:
    alone = identify(DELAYED, rng=np.random.default_rng(0))
    with over(cluster) as (made, _):
        together = identify(DELAYED, rng=np.random.default_rng(0))
    assert (made.sent, made.left) == (DELAYED.starts - 1, 0)
    # A response remembers how long the one before took to settle: that much, rounding, depends on who follows a start.
    found, wanted = together.parameters["transport.time"].value, alone.parameters["transport.time"].value
    assert found == pytest.approx(wanted, rel=1e-12)


def answering(workers: Cluster) -> set[int]:
    """Return the processes of the workers that have answered short calls, of which there are enough for each of four."""
    workers.lost()
    found = workers.open()
    return set() if found is None or found.count < 4 else set(found.executor.map(process_number, range(40)))


def process_number(_: int) -> int:
    time.sleep(0.01)  # the next call is for another one
    return os.getpid()


def test_a_killed_and_a_frozen_worker_change_nothing(cluster: DaskCluster) -> None:
    positions = np.random.default_rng(0).random((20 * 128, 2))
    alone = Evaluator(VALLEYS).assess(positions)
    frozen, killed = cluster.work(), cluster.work()
    with over(cluster, patience=2.0) as (made, workers):
        # both have answered: one that has only said that it is there is given nothing yet
        wait_for(lambda: {frozen.pid, killed.pid} <= answering(workers), "two workers more")
        frozen.send_signal(signal.SIGSTOP)
        killed.send_signal(signal.SIGKILL)
        evaluator = Evaluator(VALLEYS)
        evaluator.seconds_each = 1e-3
        found = evaluator.assess(positions)
    frozen.send_signal(signal.SIGKILL)
    for name in ("objective", "violation", "values", "doubtful"):
        np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))
    assert made.sent + made.left == 20
    assert made.left > 0  # the frozen one had some


def test_without_its_scheduler_a_search_goes_on_here(tmp_path) -> None:
    positions = np.random.default_rng(0).random((4 * 128, 2))
    alone = Evaluator(VALLEYS).assess(positions)
    own = DaskCluster(tmp_path)
    try:
        worker = own.work()
        with over(own) as (made, workers):
            worker.send_signal(signal.SIGSTOP)  # nothing is answered before the scheduler dies, while it is waited for
            evaluator = Evaluator(VALLEYS)
            evaluator.seconds_each = 1e-3
            with interruptible(own.scheduler.kill):
                found = evaluator.assess(positions)
            assert own.scheduler.wait() == -signal.SIGKILL
            assert (made.sent, made.left) == (0, 4)
            assert workers.open() is None
            again = evaluator.assess(positions)
        for name in ("objective", "violation", "values", "doubtful"):
            np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))
            np.testing.assert_array_equal(getattr(again, name), getattr(alone, name))
    finally:
        own.close()


FORWARD = """
import asyncio, sys
host, port = sys.argv[1:]
async def pump(reader, writer):
    while data := await reader.read(65536):
        writer.write(data)
        await writer.drain()
async def both(reader, writer):
    there_reader, there_writer = await asyncio.open_connection(host, int(port))
    await asyncio.gather(pump(reader, there_writer), pump(there_reader, writer), return_exceptions=True)
async def main():
    server = await asyncio.start_server(both, "127.0.0.1", 0)
    print(server.sockets[0].getsockname()[1], flush=True)
    await server.serve_forever()
asyncio.run(main())
"""


def test_a_network_that_is_cut_is_not_waited_for(cluster: DaskCluster) -> None:
    """Nothing comes through any more, and nobody says so: what forwards every byte between here and the scheduler stands still."""
    positions = np.random.default_rng(0).random((8 * 128, 2))
    alone = Evaluator(VALLEYS).assess(positions)
    host, _, port = cluster.address.removeprefix("tls://").partition(":")
    network = subprocess.Popen([sys.executable, "-c", FORWARD, host, port], stdout=subprocess.PIPE, text=True)
    try:
        assert network.stdout is not None
        address = f"tls://127.0.0.1:{int(network.stdout.readline())}"
        workers = Cluster(address, security=cluster.files, adaptive=0, here=Processes(1))
        with spread(workers, **EAGER, patience=PATIENCE) as made:
            wait_for(lambda: (found := workers.open()) is not None and found.count > 0, "workers")
            evaluator = Evaluator(VALLEYS)
            evaluator.seconds_each = 1e-3
            before = evaluator.assess(positions)
            assert (made.sent, made.left) == (8, 0)
            network.send_signal(signal.SIGSTOP)
            made._patience = 1.0
            evaluator.seconds_each = 1e-3
            cut = evaluator.assess(positions)
            assert (made.sent, made.left) == (8, 8)
            assert workers.open() is None
    finally:
        network.kill()
        network.wait()
        network.stdout.close()  # type: ignore[union-attr] # it is a pipe
    for found in (before, cut):
        np.testing.assert_array_equal(found.values, alone.values)


def test_a_scheduler_that_is_not_there_is_asked_once_and_not_waited_for(cluster: DaskCluster) -> None:
    workers = Cluster("tls://127.0.0.1:9", security=cluster.files, adaptive=8, here=Processes(1))
    assert workers.open() is None
    assert workers.open() is None
    workers.close()


def test_workers_that_are_to_come_and_do_not_are_waited_for_once(tmp_path) -> None:
    own = DaskCluster(tmp_path)
    workers = Cluster(own.address, security=own.files, adaptive=4, here=Processes(1))
    positions = np.random.default_rng(0).random((4 * 128, 2))
    alone = Evaluator(VALLEYS).assess(positions)
    try:
        with spread(workers, **EAGER, patience=0.5) as made:
            evaluator = Evaluator(VALLEYS)
            evaluator.seconds_each = 1e-3
            found = evaluator.assess(positions)
            assert (made.sent, made.left) == (0, 4)
            assert workers.open() is None
            own.work()
            wait_for(lambda: (workers._count(), workers.open())[1] is not None, "one that comes later")
    finally:
        own.close()
    np.testing.assert_array_equal(found.values, alone.values)


def test_a_large_problem_is_sent_to_those_who_do_not_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spreading, "_SMALL", 0)
    positions = np.random.default_rng(0).random((3 * 128, 2))
    alone = Evaluator(VALLEYS).assess(positions)
    evaluator = Evaluator(VALLEYS)
    evaluator.seconds_each = 1.0
    with ThreadPoolExecutor(2) as pool, spread(Threads(pool), **EAGER) as made:
        found = evaluator.assess(positions)
    np.testing.assert_array_equal(found.values, alone.values)
    assert (made.sent, made.left) == (3, 0)


class Threads:
    """Threads of this process behind the same seam."""

    def __init__(self, pool: ThreadPoolExecutor) -> None:
        self._pool = pool

    def open(self) -> spreading.Workers:
        return spreading.Workers(executor=self._pool, count=2, threaded=False)

    def lost(self) -> None:
        raise AssertionError("nothing is lost")

    def close(self) -> None:
        self._pool.shutdown()

"""Candidates over a Dask cluster of processes on this machine: what a chunk costs on its way, and what eight workers bring.

Workers only wait while a chunk's latency lasts, so that two cores can hold eight of them:

    python -m bench.spreading [--workers 8] [--chunks 80] [--latency 0.5]
"""

from __future__ import annotations

import argparse
import logging
import time
from concurrent.futures import Executor, Future, wait
from typing import Any

import numpy as np
from distributed import Client, LocalCluster

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.signals import make
from optimizers.evaluation.evaluate import Evaluator
from optimizers.evaluation.spreading import Workers, spread
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable


def problem() -> Problem:
    """Return a problem whose candidates cost microseconds."""
    lag = Block(kind="transfer_function", values={"numerator": ["=k"], "denominator": ["=t", 1.0]})
    system = System(
        parameters={name: Parameter(value=1.0, lower=0.5, upper=2.0) for name in ("k", "t")},
        blocks={"u": Block(kind="input"), "lag": lag},
        connections=(Connection(source="u", target="lag"),),
        outputs={"y": "lag"},
    )
    return Problem(
        diagram=compile_system(system),
        variables=(Variable(parameter="k"), Variable(parameter="t")),
        experiments=(Experiment(name="step", signals={"u": make("step", {})}),),
        goals=(Goal(metric="rise_time", experiment="step", output="y", sense=Sense.MINIMIZE),),
    )


def late(seconds: float, work: Any, *given: Any, **named: Any) -> Any:
    """Do some work after a while."""
    time.sleep(seconds)
    return work(*given, **named)


class Slow(Executor):
    """A cluster each of whose answers takes so much longer (s)."""

    def __init__(self, client: Client, workers: int, latency: float) -> None:
        self._inner, self._workers, self._latency = client.get_executor(pure=False), workers, latency

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Send a chunk."""
        future: Future[Any] = self._inner.submit(late, self._latency, fn, *args, **kwargs)
        return future

    def open(self) -> Workers:
        """Return the workers."""
        return Workers(executor=self, count=self._workers, threaded=False)

    def lost(self) -> None:
        """End the measurement: it would be none."""
        raise SystemExit("a chunk did not come back")

    def close(self) -> None:
        """Leave the cluster to whoever started it."""


def measured(slow: Slow, chunks: int) -> float:
    """Return how long so many chunks take, s."""
    evaluator = Evaluator(problem())
    positions = np.random.default_rng(0).random((chunks * evaluator.together, 2))
    with spread(slow, search=0.0, call=0.0, chunk=1e-9):
        evaluator.seconds_each = 1e-3
        begun = time.perf_counter()
        evaluator.assess(positions)
        return time.perf_counter() - begun


def handed_out(client: Client, tasks: int) -> float:
    """Return how many tasks that do nothing the scheduler hands out, and hears the end of, in a second."""
    executor = client.get_executor(pure=False)
    begun = time.perf_counter()
    wait([executor.submit(int) for _ in range(tasks)])
    return tasks / (time.perf_counter() - begun)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--workers", type=int, default=8)
    parser.add_argument("--chunks", type=int, default=80)
    parser.add_argument("--latency", type=float, default=0.5)
    given = parser.parse_args()
    with (
        LocalCluster(
            n_workers=given.workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.ERROR
        ) as cluster,
        Client(cluster) as client,
    ):
        measured(Slow(client, given.workers, 1.0), 2 * given.workers)  # everybody has compiled the problem
        for latency, name in ((0.0, "no latency"), (given.latency, f"{given.latency:g} s of waiting each")):
            took = min(measured(Slow(client, given.workers, latency), given.chunks) for _ in range(3))
            print(f"{given.chunks} chunks on {given.workers} workers, {name}: {took:.2f} s", end="")
            alone = given.chunks * latency
            print(f", {alone / took:.2f} x one worker" if latency else f", {1e3 * took / given.chunks:.1f} ms a chunk")
        print(f"tasks that do nothing: {max(handed_out(client, 3000) for _ in range(3)):.0f}/s through the scheduler")


if __name__ == "__main__":
    main()

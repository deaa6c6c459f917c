"""Many candidates of the inner velocity loop on one or more threads, in a process of its own: time and memory.

`python -m bench.throughput --count 1000000 --threads 2` prints one JSON object.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np

from bench import inner_velocity_loop as inner
from bench.clock import in_rounds
from bench.memory import peak_memory
from bench.table import Job, Row
from engine.screening import Screening

CHUNK = 65_536
PATIENCE = 20.0  # s that one thread may take
ROUNDS = 5


@dataclass(frozen=True, kw_only=True)
class Throughput:
    """What one run took: seconds on the wall and of CPU, and the most memory the process ever had, MB."""

    count: int
    threads: int
    wall: float
    cpu: float
    peak: float


def screen(count: int, threads: int) -> Throughput:
    """Screen ``count`` candidates, all results kept; structure and kernels are warm."""
    candidates = inner.sample(count, seed=7)
    requests = inner.requests()
    screening = Screening(inner.diagram(), requests, threads=threads)
    values = np.empty((count, len(requests)))
    growth = np.empty(count)

    def work(start: int) -> None:
        span = slice(start, start + CHUNK)
        found = screening({name: column[span] for name, column in candidates.items()})
        values[span], growth[span] = found.values, found.growth

    work(0)
    wall, cpu = time.perf_counter(), time.process_time()
    for start in range(0, count, CHUNK):
        work(start)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    peak = peak_memory()
    return Throughput(count=count, threads=threads, wall=wall, cpu=cpu, peak=peak)


def job(most: int) -> Job:
    """Measure ``most`` candidates, or as many as take twenty seconds, on two threads and on one: the best of five rounds.

    Of wall time the least says most: whatever else the machine does can only add to it. The remark gives all rounds.
    """
    probe = screen(min(most, 1024), 1)
    count = min(most, max(CHUNK, int(PATIENCE * probe.count / probe.wall)))
    runs: dict[int, list[Throughput]] = {2: [], 1: []}
    for _ in range(ROUNDS):
        for threads, found in runs.items():
            found.append(in_new_process(count, threads))
    rows = []
    for threads, found in runs.items():
        wall, peak = min(run.wall for run in found), max(run.peak for run in found)
        each = ", ".join(f"{run.wall:.2f}" for run in found)
        remark = f"{count / wall:,.0f} candidates/s, rounds of {each} s, peak {peak:,.0f} MB"
        if threads == 1:
            remark += "; " + in_rounds([run.wall for run in found], [run.wall for run in runs[2]])
        rows.append(
            Row(who=f"this engine, {threads} thread{'s' * (threads > 1)}", milliseconds=1e3 * wall, remark=remark)
        )
    return Job(title=f"inner velocity loop, {count:,} candidates, a process of its own", clock="wall", rows=rows)


def in_new_process(count: int, threads: int) -> Throughput:
    """Return what :func:`screen` takes in a process of its own."""
    command = [sys.executable, "-m", "bench.throughput", "--count", str(count), "--threads", str(threads)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603  our own module
    return Throughput(**json.loads(done.stdout))


def main() -> None:
    """Screen and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    print(json.dumps(asdict(screen(options.count, options.threads))))


if __name__ == "__main__":
    main()

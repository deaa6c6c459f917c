"""Many candidates of the inner velocity loop on one or more threads, in a process of its own: time and memory.

`python -m bench.throughput --count 1000000 --threads 2` prints one JSON object.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from bench import inner_velocity_loop as inner
from bench.clock import in_rounds
from bench.memory import peak_memory
from bench.table import Job, Row
from engine.batch.screening import Screening

CHUNK = 65_536
PATIENCE = 20.0  # s that one thread may take
ROUNDS = 7


@dataclass(frozen=True, kw_only=True)
class Throughput:
    """What one run took: seconds on the wall and of CPU, and the most memory the process ever had, MB."""

    count: int
    threads: int
    wall: float
    cpu: float
    peak: float


def screen(count: int, threads: int, start: Callable[[], object] = bool) -> Throughput:
    """Screen ``count`` candidates, all results kept; structure and kernels are warm, then ``start`` is called."""
    candidates = inner.sample(count, seed=7)
    requests = inner.requests()
    screening = Screening(inner.diagram(), requests, threads=threads)
    values = np.empty((count, len(requests)))
    growth = np.empty(count)

    def work(first: int) -> None:
        span = slice(first, first + CHUNK)
        found = screening({name: column[span] for name, column in candidates.items()})
        values[span], growth[span] = found.values, found.growth

    work(0)
    start()
    wall, cpu = time.perf_counter(), time.process_time()
    for first in range(0, count, CHUNK):
        work(first)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    peak = peak_memory()
    return Throughput(count=count, threads=threads, wall=wall, cpu=cpu, peak=peak)


def job(most: int) -> Job:
    """Measure ``most`` candidates, or as many as take twenty seconds, on two threads and on one: the best of the rounds.

    Of wall time the least says most: whatever else the machine does can only add to it. The remark gives all rounds. Two
    processes that share nothing but the machine say what its two processors are worth: more than that no threads can gain.
    """
    probe = screen(min(most, 1024), 1)
    count = min(most, max(2 * CHUNK, int(PATIENCE * probe.count / probe.wall)))
    whos: dict[str, tuple[int, int]] = {
        "this engine, 2 threads": (2, 1),
        "this engine, 1 thread": (1, 1),
        "this engine, 2 processes of 1 thread, half of them each": (1, 2),
    }
    walls: dict[str, list[float]] = {who: [] for who in whos}
    peaks = dict.fromkeys(whos, 0.0)
    for _ in range(ROUNDS):
        for who, (threads, processes) in whos.items():
            runs = in_new_processes(count // processes, threads, processes)
            walls[who].append(max(run.wall for run in runs))
            peaks[who] = max(peaks[who], sum(run.peak for run in runs))
    ours = walls["this engine, 2 threads"]
    rows = []
    for who, found in walls.items():
        each = ", ".join(f"{wall:.2f}" for wall in found)
        remark = f"{count / min(found):,.0f} candidates/s, rounds of {each} s, peak {peaks[who]:,.0f} MB"
        if found is not ours:
            remark += "; " + in_rounds(found, ours)
        rows.append(Row(who=who, milliseconds=1e3 * min(found), remark=remark))
    return Job(title=f"inner velocity loop, {count:,} candidates, a process of its own", clock="wall", rows=rows)


def in_new_processes(count: int, threads: int, processes: int) -> list[Throughput]:
    """Return what :func:`screen` takes in processes of their own, which all begin at the same moment."""
    command = [sys.executable, "-m", "bench.throughput", "--count", str(count), "--threads", str(threads), "--told"]
    running = [
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)  # noqa: S603  our own module
        for _ in range(processes)
    ]
    for process in running:
        assert process.stdout
        process.stdout.readline()  # ready
    for process in running:
        assert process.stdin
        process.stdin.write("\n")
        process.stdin.flush()
    return [Throughput(**json.loads(process.communicate()[0])) for process in running]


def _told() -> None:
    """Say that everything is ready, and wait for a line."""
    print(flush=True)
    sys.stdin.readline()


def main() -> None:
    """Screen and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--told", action="store_true", help="begin at a line of input, after a line of output")
    options = parser.parse_args()
    start = _told if options.told else bool
    print(json.dumps(asdict(screen(options.count, options.threads, start))))


if __name__ == "__main__":
    main()

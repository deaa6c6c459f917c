"""From nothing to the first metrics of the inner velocity loop: what a new process does, run as `python -m bench.cold_start`."""

from __future__ import annotations

import subprocess
import sys

from bench import inner_velocity_loop as inner
from bench.clock import wall_ms
from bench.table import Job, Row
from engine.batch.screening import Screening


def job(*, runs: int) -> Job:
    """Measure the start, on the wall clock."""
    row = Row(who="this engine, screening", milliseconds=wall_ms(in_new_process, runs=runs))
    return Job(title="new process to first metrics", clock="wall", rows=[row])


def in_new_process() -> None:
    """Start Python, import the engine, read the document, and screen one candidate."""
    subprocess.run([sys.executable, "-m", "bench.cold_start"], check=True, capture_output=True)


def main() -> None:
    """Screen one candidate and print its metrics."""
    found = Screening(inner.diagram(), inner.requests())(inner.sample(1, seed=0))
    print(*found.values[0])


if __name__ == "__main__":
    main()

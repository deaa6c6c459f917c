"""Time as the benchmark counts it: medians, after a call that warms up where there is more than one."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any


def cpu_ms(work: Callable[[], Any], *, runs: int) -> float:
    """Return the median CPU milliseconds of one call of ``work``; the machine may be shared, so the wall clock says less."""
    return _median(work, runs, time.process_time)


def wall_ms(work: Callable[[], Any], *, runs: int) -> float:
    """Return the median wall-clock milliseconds of one call of ``work``."""
    return _median(work, runs, time.perf_counter)


def _median(work: Callable[[], Any], runs: int, clock: Callable[[], float]) -> float:
    if runs > 1:
        work()
    times = []
    for _ in range(runs):
        begin = clock()
        work()
        times.append(clock() - begin)
    return 1e3 * statistics.median(times)

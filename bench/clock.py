"""Time as the benchmark counts it: medians, after a call that warms up where there is more than one."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any


def cpu_ms(work: Callable[[], Any], *, runs: int) -> float:
    """Return the median CPU milliseconds of one call of ``work``; the machine may be shared, so the wall clock says less."""
    return _median(work, runs, time.process_time)


def wall_ms(work: Callable[[], Any], *, runs: int) -> float:
    """Return the median wall-clock milliseconds of one call of ``work``."""
    return _median(work, runs, time.perf_counter)


def side_by_side(works: Mapping[str, Callable[[], Any]], *, rounds: int) -> dict[str, list[float]]:
    """Return the CPU milliseconds of each work in each round, all works once in every round.

    Works of one round meet the same machine, however its speed varies: their ratio says more than that of two medians.
    """
    found: dict[str, list[float]] = {who: [] for who in works}
    for work in works.values() if rounds > 1 else ():
        work()
    for _ in range(rounds):
        for who, work in works.items():
            begin = time.process_time()
            work()
            found[who].append(1e3 * (time.process_time() - begin))
    return found


def in_rounds(theirs: Sequence[float], ours: Sequence[float], *, calls: int = 1) -> str:
    """Say how many times longer ``calls`` calls of theirs take than one of ours, each in the same round."""
    found = [calls * their / our for their, our in zip(theirs, ours, strict=True)]
    middle, least, most = (
        f"{ratio:,.{2 if ratio < 100 else 0}f}" for ratio in (statistics.median(found), min(found), max(found))
    )
    return f"takes {middle}x, {least} to {most} in {len(found)} rounds side by side"


def _median(work: Callable[[], Any], runs: int, clock: Callable[[], float]) -> float:
    if runs > 1:
        work()
    times = []
    for _ in range(runs):
        begin = clock()
        work()
        times.append(clock() - begin)
    return 1e3 * statistics.median(times)

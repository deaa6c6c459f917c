"""Many points in blocks: large enough for the batch kernels, small enough that a cancel is heard.

A candidate costs microseconds or a tenth of a second, so the size of a block follows the time that the last one took. What
is found does not depend on it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

from optimizers.evaluation.evaluate import Assessment, Cost, Matrix
from optimizers.search.search import Tracker

_LEAST = {Cost.KERNELS: 1, Cost.BATCHES: 64, Cost.SIMULATION: 1}
"""Points of the smallest block, and of the first: in a batch fewer take as long, and by itself a single one may take a second."""
_FIRST = 128
"""Points of the first block for compiled kernels."""
_LARGEST = 16_384
_SHORT, _LONG = 0.15, 0.4
"""Seconds: blocks that take less grow, those that take more shrink."""


def in_blocks(tracker: Tracker, positions: Matrix, *, roughly: bool = False) -> Iterator[tuple[slice, Assessment]]:
    """Evaluate points block by block; yield which rows they were and what was found.

    The budget is used up to its last evaluation before the search stops.

    Parameters
    ----------
    tracker : Tracker
    positions : ndarray, shape (B, V)
        In the unit cube.
    roughly : bool
        For a first look: what the fast evaluation doubts is not looked at again.

    Raises
    ------
    Stopped
        When cancelled or out of budget.
    """
    least, first = _LEAST[tracker.evaluator.cost], 0
    size = _FIRST if tracker.evaluator.cost is Cost.KERNELS else least
    while first < len(positions):
        left = tracker.budget - tracker.evaluator.evaluations
        rows = slice(first, min(first + size, len(positions), first + max(left, 1)))
        begin = time.perf_counter()
        found = tracker.assess(positions[rows], roughly=roughly)
        taken = time.perf_counter() - begin
        yield rows, found
        first = rows.stop
        if taken < _SHORT:
            size = min(2 * size, _LARGEST)
        elif taken > _LONG:
            size = max(size // 4, least)

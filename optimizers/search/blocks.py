"""Many points in blocks: large enough for the batch kernels, small enough that a cancel is heard.

A candidate costs microseconds or a tenth of a second, so the size of a block follows the time that the last one took. A block
ends where neighbours end (`Evaluator.together`), so that what is found does not depend on it, to the bit.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

from optimizers.evaluation.evaluate import Assessment, Matrix
from optimizers.evaluation.spreading import fitting
from optimizers.search.search import Tracker

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
    least, first = tracker.evaluator.together, 0
    size = least
    while first < len(positions):
        left = tracker.budget - tracker.evaluator.evaluations
        # Others compute larger ones: a cancel is heard while they are waited for.
        wanted = fitting(tracker.evaluator, len(positions) - first) or size
        rows = slice(first, min(first + wanted, len(positions), first + max(left, 1)))
        begin = time.perf_counter()
        found = tracker.assess(positions[rows], roughly=roughly)
        taken = time.perf_counter() - begin
        yield rows, found
        first = rows.stop
        if taken < _SHORT:
            size = min(2 * size, _LARGEST)
        elif taken > _LONG:
            size = max(size // 4, least)

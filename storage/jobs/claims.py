"""Finds jobs that the job engine has claimed for this worker and never put into its hands.

The engine claims a job in one transaction and reads what to do in another. When the database goes away between the two, or before
it has answered the first, the job is this worker's as long as it lives, and nobody computes it. The same for ``patience``
of a clock that nobody sets tells that from a job that is about to begin::

    forgotten:  claimed, and not in hand, at every look for ``patience``
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection


class Claims:
    """Remembers since when each claim has been without a beginning.

    Parameters
    ----------
    patience : float
        How long (s) a claim may take to begin.
    clock : callable
        Monotonic time in s.
    """

    def __init__(self, patience: float, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._patience = patience
        self._clock = clock
        self._since: dict[str, float] = {}

    def forgotten(self, claimed: Collection[str], *, in_hand: Collection[str]) -> list[str]:
        """Take note of the tickets that are claimed and of those in hand, and return the forgotten ones."""
        now = self._clock()
        self._since = {ticket: self._since.get(ticket, now) for ticket in claimed if ticket not in in_hand}
        return [ticket for ticket, since in self._since.items() if now - since >= self._patience]

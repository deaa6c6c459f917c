"""Tells the dead workers from the living by whether their heartbeats change.

How old a heartbeat is would be told by two clocks, the worker's and the reader's, and either may be wrong or be set. Whether
it is the same as ten seconds ago takes one clock, which nobody sets::

    dead:  seen_at the same for ``patience`` of this process' monotonic clock, or the mark of a worker that has stopped
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from datetime import datetime

from storage.models import Worker
from storage.repositories.workers import RETIRED


class Pulse:
    """Remembers when each worker's heartbeat last changed.

    Parameters
    ----------
    patience : float
        Silence (s) after which a worker is dead.
    clock : callable
        Monotonic time in s.
    """

    def __init__(self, patience: float, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._patience = patience
        self._clock = clock
        self._changed: dict[str, tuple[str, datetime, float]] = {}  # token, heartbeat, and when it was first seen

    def dead(self, workers: Sequence[Worker]) -> list[Worker]:
        """Take note of all workers as they are now, and return those that have stopped or gone silent."""
        now = self._clock()
        known, self._changed = self._changed, {}
        silent = []
        for worker in workers:
            token, seen_at, since = known.get(worker.id, ("", RETIRED, now))
            if (token, seen_at) != (worker.token, worker.seen_at):
                since = now
            self._changed[worker.id] = (worker.token, worker.seen_at, since)
            if worker.seen_at == RETIRED or now - since >= self._patience:
                silent.append(worker)
        return silent

"""Tells the dead workers from the living by whether their heartbeats change.

How old a heartbeat is would be told by two clocks, the worker's and the reader's, and either may be wrong or be set. Whether
it is the same as ten seconds ago takes one clock, which nobody sets::

    dead:  seen_at the same for ``patience`` of this process' monotonic clock, or the mark of a worker that has stopped,
           or a process of this machine that is not there any more

While nobody can look, because the database is away or this process stands still, nobody can show himself either: of the time
between two looks at most a quarter of ``patience`` counts, so that everybody has several heartbeats to come back with.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from datetime import datetime

from storage import processes
from storage.repositories.workers import RETIRED, Heartbeat


class Pulse:
    """Remembers how long each worker's heartbeat has been the same.

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
        self._looked = clock()
        self._silent: dict[str, tuple[str, datetime, float]] = {}  # token, heartbeat, and how long it has been the same

    def dead(self, workers: Sequence[Heartbeat]) -> list[Heartbeat]:
        """Take note of all workers as they are now, and return those that have stopped or gone silent."""
        now = self._clock()
        passed, self._looked = min(now - self._looked, self._patience / 4), now
        known, self._silent = self._silent, {}
        dead = []
        for worker in workers:
            token, seen_at, silence = known.get(worker.id, ("", RETIRED, 0.0))
            silence = silence + passed if (token, seen_at) == (worker.token, worker.seen_at) else 0.0
            self._silent[worker.id] = (worker.token, worker.seen_at, silence)
            ended = worker.seen_at == RETIRED or processes.alive(worker.process) is False
            if ended or silence >= self._patience:
                dead.append(worker)
        return dead

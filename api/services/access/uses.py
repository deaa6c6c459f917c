"""When keys were last used: written once a minute for each, behind the requests, which never wait for a writer."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable

from storage.errors import UNAVAILABLE
from storage.repositories import note_uses
from storage.session import Database

#: s between two writings of one key.
_EVERY = 60.0
_MOST_KEYS = 10_000

_log = logging.getLogger("servotune.api")


class Uses:
    """The keys that were used in this process, and are to be written down.

    Parameters
    ----------
    database : Database
    clock : callable
        The time in s.
    """

    def __init__(self, database: Database, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._database = database
        self._clock = clock
        self._lock = threading.Lock()
        self._noted: dict[str, float] = {}
        self._due: set[str] = set()

    def note(self, key: str) -> None:
        """Remember that a key is used now."""
        now = self._clock()
        if now - self._noted.get(key, -math.inf) < _EVERY:
            return
        with self._lock:
            self._noted.pop(key, None)
            self._noted[key] = now
            self._due.add(key)
            if len(self._noted) > _MOST_KEYS:
                del self._noted[next(iter(self._noted))]

    @property
    def due(self) -> bool:
        """Whether there is anything to write."""
        return bool(self._due)

    def write(self) -> None:
        """Write down what is due; a database that cannot is told about the next use."""
        with self._lock:
            keys, self._due = self._due, set()
        if not keys:
            return
        try:
            with self._database.session() as session:
                note_uses(session, keys)
        except UNAVAILABLE as error:
            _log.debug("the last use of %d keys could not be written: %s", len(keys), error)

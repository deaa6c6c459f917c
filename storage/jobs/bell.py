"""Lets a worker sleep until there may be a job for it, in place of asking ten times a second.

Whoever hands out jobs rings, within the transaction that writes them; Postgres tells all who listen when that is committed. A worker
that has been woken asks often for a while, because what it was woken for may be followed by more; one that hears nothing asks now and
then all the same. Where nobody can listen (SQLite, a pooler, a server that is away) it asks as often as without a bell.
"""

from __future__ import annotations

import logging
import select
import threading
import time

import psycopg
from sqlalchemy import text
from sqlalchemy.orm import Session

from storage.errors import UNAVAILABLE
from storage.session import Database

_CHANNEL = "servotune_work"
#: s for which a worker asks often after it was woken, s after which it asks unasked, and s between two tries to listen.
_LIVELY, _UNASKED, _AGAIN = 2.0, 10.0, 1.0
#: s between two looks whether the worker ends.
_LOOK = 0.2

_CUT_OFF: tuple[type[Exception], ...] = (psycopg.Error, *UNAVAILABLE)

_log = logging.getLogger(__name__)


def ring(session: Session) -> None:
    """Wake all workers when the transaction is committed."""
    if session.get_bind().dialect.name == "postgresql":
        session.execute(text(f"SELECT pg_notify('{_CHANNEL}', '')"))


class Bell:
    """Listens for one worker.

    Parameters
    ----------
    database : Database
        One connection of it, or rather beside it, is kept for listening; none where a pooler is in between.
    ended : threading.Event
        Ends `listen`.
    """

    def __init__(self, database: Database, *, ended: threading.Event) -> None:
        self._engine = database.engine
        self._can_listen = database.engine.dialect.name == "postgresql" and not database.pooled
        self._ended = ended
        self._rung = threading.Event()
        self._listening = False
        self._lively_until = time.monotonic() + _LIVELY
        self._sleeps = 0
        #: Which of its sleeps this worker is in; None while it asks for jobs.
        self.asleep: int | None = None

    def wake(self) -> None:
        """Wake this worker."""
        self._rung.set()

    def wait(self) -> None:
        """Return when it is time to ask for a job."""
        if not self._listening or self._ended.is_set():
            return
        if time.monotonic() >= self._lively_until:
            self._sleeps += 1
            self.asleep = self._sleeps
            self._rung.wait(_UNASKED)
            self.asleep = None
        if self._rung.is_set():
            self._rung.clear()
            self._lively_until = time.monotonic() + _LIVELY

    def listen(self) -> None:
        """Listen until the worker ends; to be run in a thread of its own."""
        if not self._can_listen:
            return
        while not self._ended.is_set():
            try:
                self._listen()
            except _CUT_OFF as error:
                _log.warning("a worker asks for jobs again and again, because it cannot listen: %s", error)
            finally:
                self._listening = False
                self.wake()  # whatever was said meanwhile was not heard
            self._ended.wait(_AGAIN)

    def _listen(self) -> None:
        connection = self._engine.raw_connection()
        connection.detach()
        own = connection.dbapi_connection
        assert isinstance(own, psycopg.Connection)
        with own:
            own.autocommit = True
            own.execute(f"LISTEN {_CHANNEL}".encode())
            self._listening = True
            self.wake()
            while not self._ended.is_set():
                # psycopg's own wait wakes ten times a second; the system's does not, and a look at what has come never waits.
                if select.select([own.fileno()], [], [], _LOOK)[0] and list(own.notifies(timeout=0)):
                    self.wake()

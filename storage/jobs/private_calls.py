"""All that is used of the job engine beyond its public interface: one function for each, and a test for each.

`tests/integration/storage/test_private_calls.py` fails by name where a new version of the engine has changed one of them.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from dbos import DBOS, DBOSClient
from dbos._error import DBOSInitializationError
from sqlalchemy import Engine

#: How often (s) the engine asks what does not change.
_SELDOM = 60.0


def tables_are_current(engine: Engine) -> bool:
    """Return whether the engine's tables are as this version of it needs them; there is no public question."""
    client = DBOSClient(system_database_engine=engine, lazy=True, retry_connection_errors=False)
    try:
        client._sys_db.verify_migrations()
    except DBOSInitializationError:
        return False
    finally:
        client.destroy()
    return True


def recover(executors: Sequence[str]) -> None:
    """Put the unfinished workflows of executors that have died back into their queues, where any other one takes them.

    The engine does this for an executor that starts again under its old name; for one that does not there is a commercial
    service only.
    """
    if executors:
        DBOS._recover_pending_workflows(list(executors))


def running_workflows(engine: DBOS, queue: str) -> int:
    """Return how many workflows of a queue this process has begun whose end is not written down yet."""
    return engine._active_workflows_set.count_for_queue(queue)


def limit_claims(engine: DBOS, queue: str, free: Callable[[], int], *, wait: Callable[[], None] = lambda: None) -> None:
    """Let this process take as many workflows of a queue as ``free`` says whenever it looks, which it does when ``wait`` returns.

    The engine keeps one number for all processes in the database and reads it before it takes a workflow; what it reads is
    answered here.
    """
    database = engine._sys_db
    read = database.get_queue

    def get_queue(name: str, **more: Any) -> Any:
        if name == queue:
            wait()
        found = read(name, **more)
        if found is not None and name == queue:
            found._worker_concurrency = found._partition_worker_concurrency = free()
            found._partition_concurrency = None
        return found

    database.get_queue = get_queue  # type: ignore[method-assign]


def rest(engine: DBOS, elected: Callable[[], bool]) -> None:
    """Let this process ask no more of the database than it needs while there is nothing to do.

    The engine asks each second which queues and schedules there are, whether its internal queue has anything (it never has: workflows of ours
    have a queue of their own), and whether this process may look after delays and timeouts, which one of all does: the one that
    is ``elected`` here.
    """
    database = engine._sys_db
    engine._registry.get_internal_queue()._polling_interval_sec = _SELDOM
    lock = database.background_job_lock

    @contextmanager
    def lock_of_one(job_name: str) -> Iterator[bool]:
        if not elected():
            yield False
            return
        with lock(job_name) as acquired:
            yield acquired

    database.list_queues = _seldom(database.list_queues)  # type: ignore[method-assign]
    database.list_schedules = _seldom(database.list_schedules)  # type: ignore[method-assign]
    database.background_job_lock = lock_of_one  # type: ignore[method-assign]


def _seldom(ask: Callable[..., list[Any]]) -> Callable[..., list[Any]]:
    """Return what answers as the last time unless that was long ago; who comes while another asks waits for the same answer."""
    known: list[Any] = []
    due_at, asking = 0.0, threading.Lock()

    def answer(**more: Any) -> list[Any]:
        nonlocal known, due_at
        with asking:
            if time.monotonic() >= due_at:
                known = ask(**more)
                due_at = time.monotonic() + _SELDOM
            return known

    return answer

"""All that is used of the job engine beyond its public interface: one function for each, and a test for each.

`tests/integration/storage/test_private_calls.py` fails by name where a new version of the engine has changed one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from dbos import DBOS, DBOSClient
from dbos._error import DBOSInitializationError
from sqlalchemy import Engine


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

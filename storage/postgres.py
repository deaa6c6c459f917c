"""How connections to Postgres are used so that a question costs one round trip: without a transaction, and without a ping.

On the isolation level READ COMMITTED every statement sees what was committed before it began, in a transaction or not. So a
transaction begins with the first statement that writes or locks, as on SQLite; before that there is neither a BEGIN nor a
COMMIT. A server that went away has closed its end, which the socket tells without asking anybody; only a connection that
nobody has used for a while is tried out, because what lies between may have forgotten it.

A process that stands still in the middle of a transaction (stopped, paused with its machine, cut off from the network) would keep
what it has locked until its connection is given up, which takes hours. The server waits for its next statement for as long as
`LONGEST_PAUSE`, then undoes the transaction: a job goes on elsewhere in the time that is promised.

A pooler that lends a connection of the server for one transaction at a time (PgBouncer's ``pool_mode = transaction``) keeps nothing of a
session: what is set is set in each transaction, and no statement is prepared.
"""

from __future__ import annotations

import re
import select
import time
from collections.abc import Generator
from functools import partial
from typing import Any

import psycopg
from sqlalchemy import Connection, Engine, Row, Select, event
from sqlalchemy.engine import ExecutionContext
from sqlalchemy.engine.default import DefaultExecutionContext
from sqlalchemy.exc import InvalidatePoolError
from sqlalchemy.orm import Session
from sqlalchemy.pool import ConnectionPoolEntry

from storage.errors import DatabaseUrlError

#: s without use after which a connection is tried out before it is used again.
IDLE = 30.0

#: s that a transaction waits for its next statement: less than what it takes to miss a worker and let another one go on.
LONGEST_PAUSE = 10.0

_USED_AT = "used at"
#: SELECT ... FOR UPDATE locks; what only looks like it begins a transaction that it does not need.
_LOCKS = re.compile(r"\bFOR\b")


def require_unicode(connection: psycopg.Connection[Any], _record: object) -> None:
    """Refuse a Postgres database whose texts are not Unicode: they would come as bytes, or not at all."""
    encoding = connection.info.parameter_status("server_encoding")
    if encoding != "UTF8":
        raise DatabaseUrlError(
            f"the database must have the encoding UTF8, got {encoding}: make one by createdb --encoding=UTF8 --template=template0"
        )


def use_sparingly(engine: Engine, *, pooled: bool = False) -> None:
    """Let an engine ask no more of Postgres than it must.

    Parameters
    ----------
    pooled : bool
        Whether a pooler lends connections for one transaction at a time.
    """
    event.listen(engine, "connect", _keep_no_session if pooled else _wait_for_a_write)
    event.listen(engine, "checkin", _wait_for_the_next)
    event.listen(engine, "checkout", _look_at)
    event.listen(engine, "before_cursor_execute", partial(_begin_to_write, pooled=pooled))


def take_time(connection: Connection) -> None:
    """Let the transaction of a connection wait for its next statement as long as that takes: all is copied, or migrated."""
    if connection.dialect.name == "postgresql":
        connection.exec_driver_sql("SET LOCAL idle_in_transaction_session_timeout = 0")


def in_pieces(session: Session, rows: Select[*tuple[Any, ...]], *, size: int) -> Generator[Row[*tuple[Any, ...]]]:
    """Give the rows of a long selection, ``size`` of them in memory at a time.

    On Postgres that takes a cursor of the server's, and this a transaction, which ends with the last row unless it was begun before:
    whoever goes on to compute must not keep one.
    """
    own = session.connection().connection.dbapi_connection
    alone = isinstance(own, psycopg.Connection) and own.autocommit
    with session.execute(rows, execution_options={"yield_per": size}) as found:
        yield from found
    if alone:
        assert isinstance(own, psycopg.Connection)
        own.commit()
        own.autocommit = True


def _wait_for_a_write(connection: psycopg.Connection[Any], _entry: ConnectionPoolEntry) -> None:
    connection.autocommit = True
    connection.execute(f"SET {_pause()}".encode())


def _pause() -> str:
    return f"idle_in_transaction_session_timeout = {1000 * LONGEST_PAUSE:.0f}"


def _keep_no_session(connection: psycopg.Connection[Any], _entry: ConnectionPoolEntry) -> None:
    connection.autocommit = True
    connection.prepare_threshold = None


def _wait_for_the_next(connection: psycopg.Connection[Any] | None, entry: ConnectionPoolEntry) -> None:
    entry.info[_USED_AT] = time.monotonic()
    if connection is not None and not connection.closed:
        connection.autocommit = True


def _begin_to_write(
    connection: Connection,
    _cursor: Any,
    statement: str,
    _parameters: Any,
    context: ExecutionContext | None,
    *_: Any,
    pooled: bool,
) -> None:
    """Let psycopg begin a transaction in front of a statement that may write or lock."""
    if "isolation_level" in connection.get_execution_options():
        return  # whoever chose one has chosen this, too
    own = connection.connection.dbapi_connection
    assert isinstance(own, psycopg.Connection)
    if own.autocommit and not _only_reads(statement, context):
        own.autocommit = False
        if pooled:
            own.execute(f"SET LOCAL {_pause()}".encode())


def _only_reads(statement: str, context: ExecutionContext | None) -> bool:
    """Tell whether a statement surely only reads; one that was written as text, or names a cursor, does not surely so."""
    return (
        isinstance(context, DefaultExecutionContext)
        and context.compiled is not None
        and not context.is_text
        and not context._is_server_side  # noqa: SLF001 - its cursor lives as long as its transaction; nothing else tells
        and statement.startswith("SELECT")
        and _LOCKS.search(statement) is None
    )


def _look_at(connection: psycopg.Connection[Any], entry: ConnectionPoolEntry, _fairy: Any) -> None:
    """Refuse a connection that the server has closed; whoever asked gets a new one."""
    used_at = entry.info.get(_USED_AT)
    if used_at is None:
        return  # it was just opened
    if time.monotonic() - used_at <= IDLE and not _told_something(connection):
        return
    try:
        connection.execute("")
    except psycopg.Error as error:
        raise InvalidatePoolError from error


def _told_something(connection: psycopg.Connection[Any]) -> bool:
    """Tell whether the server has said anything unasked, as the end of the connection is."""
    if connection.closed:
        return True
    looking = select.poll()
    looking.register(connection.fileno(), select.POLLIN)
    return bool(looking.poll(0))

"""Opens the database, SQLite or Postgres, so that both behave alike.

On both, a statement sees what was committed before it began, and a transaction begins with its first write, which waits for
its turn (SQLite: ``BEGIN IMMEDIATE``, so that a reader never has to become a writer too late).
"""

from __future__ import annotations

import json
import math
import os
import shutil
import sqlite3
import stat
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Engine, ExceptionContext, create_engine, event, make_url, select
from sqlalchemy.exc import ArgumentError, OperationalError
from sqlalchemy.orm import Session, sessionmaker
from sqlalchemy.pool import ConnectionPoolEntry

from storage.clock import JumpDetector, shared_now
from storage.errors import DatabaseUrlError, DocumentError, FullDiskError, is_full, is_refusal
from storage.objects import ObjectStore
from storage.postgres import require_unicode, use_sparingly

#: How long (s) a writer waits for another one before the database counts as unavailable.
LOCK_TIMEOUT = 30.0

#: As many connections as a process has threads, opened when they are needed and then kept: to open one anew in a crowd
#: takes longer than what it is opened for. The one given back last is taken first, so that few are in use.
CONNECTIONS = 40

#: How long (s) a Postgres that does not even refuse may take to let somebody in.
CONNECT_TIMEOUT = 10

#: Bytes that SQLite needs beside a file, for the index of its write-ahead log, and some pages.
_LEAST_FREE = 1 << 16

#: Values of statements stay out of logs and messages: they are the users' documents and the hashes of their keys.
_ENGINE: dict[str, Any] = {"max_overflow": 0, "pool_use_lifo": True, "hide_parameters": True}


@dataclass(frozen=True, slots=True, kw_only=True)
class Database:
    """An open database: one per process, safe to share between threads, never across a fork."""

    url: str = field(repr=False)
    engine: Engine
    sessions: sessionmaker[Session]
    #: Whether a pooler in front of Postgres lends connections for one transaction at a time: nobody can listen then, or lock for a session.
    pooled: bool = False
    #: Where blobs may lie beside the database.
    objects: ObjectStore | None = None
    _closed: threading.Event = field(default_factory=threading.Event, repr=False)

    def __post_init__(self) -> None:
        event.listen(self.engine, "checkin", self._close_late)

    @contextmanager
    def session(self) -> Iterator[Session]:
        """Give a session in a transaction that is committed at the end, rolled back when an exception passes."""
        with self.sessions.begin() as session:
            yield session

    @contextmanager
    def one_by_one(self) -> Iterator[Session]:
        """Give a session each statement of which is a transaction of its own: on Postgres one round trip and not three."""
        if self.engine.dialect.name == "sqlite":
            with self.session() as session:
                yield session
            return
        with (
            self.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection,
            self.sessions(bind=connection) as session,
        ):
            yield session

    def migrate(self) -> None:
        """Bring every table up to date; two processes that start at once wait for each other.

        Raises
        ------
        DatabaseUrlError
            When there is a pooler in between: the lock that the others wait for belongs to a session.
        """
        self.require_direct()
        from storage import migrations  # noqa: PLC0415 - alembic and dbos cost a second; children never migrate

        try:
            migrations.upgrade(self.engine, self.url)
        except OperationalError as error:  # the job engine makes its tables by a connection of its own
            if isinstance(error, FullDiskError) or not is_full(error.orig):
                raise
            raise _full(error.statement, error.orig, self.engine.url) from error

    def require_direct(self) -> None:
        """Make sure that the tables can be migrated.

        Raises
        ------
        DatabaseUrlError
            When there is a pooler in between.
        """
        if self.pooled:
            raise DatabaseUrlError(
                "tables must be migrated past the pooler: SERVOTUNE_DIRECT_DATABASE_URL must name the server itself"
            )

    def is_current(self) -> bool:
        """Return whether every table is as this version of the software needs it."""
        from storage import migrations  # noqa: PLC0415 - as above

        return migrations.is_current(self.engine)

    def serves(self) -> bool:
        """Return whether this version of the software can work with the tables: they are as it needs them, or a later version has added to them."""
        from storage import migrations  # noqa: PLC0415 - as above

        return migrations.serves(self.engine)

    def ping(self) -> None:
        """Ask the database for one number.

        Raises
        ------
        storage.errors.UNAVAILABLE
            When it does not answer.
        """
        with self.engine.connect() as connection:
            connection.execute(select(1))

    def now(self) -> datetime:
        """Return the time of now by the clock that all who use the database share.

        Raises
        ------
        storage.errors.UNAVAILABLE
            When it does not answer.
        """
        with self.session() as session:
            return shared_now(session)

    def dispose(self) -> None:
        """Close every connection; one that a thread is still at work with is closed when it is given back."""
        self._closed.set()
        self.engine.dispose()

    def _close_late(self, _connection: Any, entry: ConnectionPoolEntry) -> None:
        if self._closed.is_set():
            entry.close()


def open_database(url: str, *, connections: int = CONNECTIONS, objects: ObjectStore | None = None) -> Database:
    """Open a database without touching it; tables appear with `Database.migrate`.

    Parameters
    ----------
    url : str
        ``sqlite:///path.db`` or ``postgresql+psycopg://user:password@host/name``; ``?pooler=transaction`` says that the host is a
        pooler that lends connections for one transaction at a time.
    connections : int
        The most that are open at a time.
    objects : ObjectStore, optional
        Where blobs may lie beside the database.

    Raises
    ------
    DatabaseUrlError
        When the URL names neither, or a SQLite database that only this connection would see, or a pooler of another kind.
    """
    parsed = _parse(url)
    pooled = "pooler" in parsed.query
    options = _ENGINE | {"json_serializer": _to_json, "pool_size": connections}
    if parsed.get_backend_name() == "sqlite":
        engine = create_engine(parsed, connect_args={"timeout": LOCK_TIMEOUT}, **options)
        event.listen(engine, "do_connect", _make_own)
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(engine, "handle_error", partial(_name_the_full_disk, engine.url))
    else:
        patience = {} if "connect_timeout" in parsed.query else {"connect_timeout": CONNECT_TIMEOUT}
        engine = create_engine(parsed.difference_update_query(["pooler"]), connect_args=patience, **options)
        event.listen(engine, "connect", require_unicode, insert=True)
        use_sparingly(engine, pooled=pooled)
        event.listen(engine, "handle_error", _count_refusals_as_unavailable)
        event.listen(engine, "handle_error", partial(_name_the_full_disk, engine.url))
    return Database(
        url=parsed.render_as_string(hide_password=False),
        engine=engine,
        sessions=sessionmaker(engine, expire_on_commit=False, info={"jumps": JumpDetector(), "objects": objects}),
        pooled=pooled,
        objects=objects,
    )


def _count_refusals_as_unavailable(context: ExceptionContext) -> None:
    """Raise what a server says that is read-only, or has undone a transaction, as what it is: a database that cannot do its work now."""
    cause = context.original_exception
    if is_refusal(cause):
        raise OperationalError(context.statement, None, cause, hide_parameters=True) from cause


def _name_the_full_disk(url: URL, context: ExceptionContext) -> None:
    """Raise that a disk is full with the name of the file, or of the server: a copy has two of them.

    Where not even the index of the write-ahead log has room SQLite says no more than that it cannot read or write.
    """
    cause = context.original_exception
    code = getattr(cause, "sqlite_errorcode", 0) & 0xFF
    if is_full(cause) or (
        code == sqlite3.SQLITE_IOERR and _free(Path(str(url.database)).absolute().parent) < _LEAST_FREE
    ):
        raise _full(context.statement, cause, url) from cause


def _full(statement: str | None, cause: BaseException | None, url: URL) -> FullDiskError:
    assert cause is not None
    error = FullDiskError(statement, None, cause, hide_parameters=True)
    sqlite = url.get_backend_name() == "sqlite"
    error.place = str(url.database) if sqlite else url.render_as_string(hide_password=True)
    return error


def _free(directory: Path) -> float:
    try:
        return shutil.disk_usage(directory).free
    except OSError:  # another fault, which SQLite has told
        return math.inf


def _to_json(document: Any) -> str:
    """Refuse NaN and infinity here, for both databases; Postgres alone would."""
    try:
        return json.dumps(document, allow_nan=False, separators=(",", ":"))
    except (TypeError, ValueError) as error:
        raise DocumentError(f"a document must be JSON, got {error}") from error


def _parse(url: str) -> URL:
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise DatabaseUrlError("database URL must be sqlite:///<path> or postgresql://<server>/<name>") from error
    if parsed.drivername in {"postgres", "postgresql"}:
        parsed = parsed.set(drivername="postgresql+psycopg")
    if parsed.drivername not in {"sqlite", "sqlite+pysqlite", "postgresql+psycopg"}:
        raise DatabaseUrlError(f"database must be sqlite or postgresql, got {parsed.drivername!r}")
    pooler = parsed.query.get("pooler", "transaction")
    if pooler != "transaction":
        raise DatabaseUrlError(f"pooler of the database URL must be transaction, got {pooler!r}")
    if parsed.get_backend_name() == "sqlite" and "pooler" in parsed.query:
        raise DatabaseUrlError("pooler of the database URL must stand in front of Postgres, got an SQLite database")
    if parsed.get_backend_name() == "sqlite" and (parsed.database or ":memory:") == ":memory:":
        raise DatabaseUrlError("SQLite database must be a file, because workers open it too, got ':memory:'")
    return parsed


def _make_own(_dialect: Any, _record: Any, arguments: list[Any], _options: Any) -> None:
    """Make a file that is not there yet readable by its user alone; SQLite gives -wal and -shm the mode of the database."""
    # a directory that is not there is SQLite's to report
    with suppress(OSError):
        os.close(os.open(str(arguments[0]), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))


def sqlite_file(url: str) -> Path | None:
    """Return the path of a SQLite database; None for one on a server."""
    parsed = _parse(url)
    return Path(str(parsed.database)) if parsed.get_backend_name() == "sqlite" else None


def readable_by_others(url: str) -> str | None:
    """Return the path of a SQLite database that other users of the machine can read; None where they cannot."""
    path = sqlite_file(url)
    if path is None or os.name != "posix":
        return None
    shared = stat.S_IRGRP | stat.S_IROTH
    return str(path) if path.is_file() and path.stat().st_mode & shared else None


def _prepare_sqlite(connection: sqlite3.Connection, _record: Any) -> None:
    """Let readers work beside one writer, survive a crash of the process, and keep foreign keys."""
    connection.isolation_level = "IMMEDIATE"
    connection.execute(f"PRAGMA busy_timeout = {int(LOCK_TIMEOUT * 1000)}").close()
    _write_ahead(connection)
    connection.execute("PRAGMA synchronous = NORMAL").close()
    connection.execute("PRAGMA foreign_keys = ON").close()
    # SQLite's own knows the letters of English alone; Postgres those of its locale.
    connection.create_function("lower", 1, lambda text: text and str(text).lower(), deterministic=True)


def _write_ahead(connection: sqlite3.Connection) -> None:
    """Switch the file to write-ahead logging, once for ever.

    SQLite does not wait for a lock here, as it does elsewhere: of two processes that open a new file at once, one
    is refused, and has to ask again.
    """
    deadline = time.monotonic() + LOCK_TIMEOUT
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL").close()
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_BUSY or time.monotonic() > deadline:
                raise
            time.sleep(0.01)
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            (_, _, path) = connection.execute("PRAGMA database_list").fetchone()
            raise DatabaseUrlError(
                f"{path} must be a SQLite database, got a file that is none or is damaged ({error}): name another one, or restore a backup"
            ) from error
        else:
            return

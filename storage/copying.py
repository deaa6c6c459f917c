"""Copies every row from one database into another, of whatever kind, and proves that all of them have arrived.

What is copied is one snapshot: the source may be in use. A table's digest is the sum of the SHA-256 of its rows, modulo
2^256, so that it depends neither on the order of the rows nor on the kind of database. The job engine's own tables stay
behind: unfinished jobs are handed to the engine of the target anew.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, Engine, Table, delete, func, insert, select, update
from sqlalchemy.exc import DataError, DBAPIError, IntegrityError, StatementError
from sqlalchemy.orm import Session

from storage.errors import CopyError
from storage.models import DEFAULT_WORKSPACE, Base, Elected, Job, JobStatus, Worker, Workspace
from storage.postgres import take_time

#: Rows that are held in memory together; the chunks of blobs are up to 8 MiB each.
_BATCH, _BATCH_OF_CHUNKS = 500, 4
#: Who worked at the old place works there no more.
_LEFT_OUT = frozenset({Elected.__tablename__, Worker.__tablename__})

Tell = Callable[[str, int], None]
"""Takes a table's name and how many of its rows have been copied."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Content:
    """What is in one table."""

    rows: int
    digest: str


def tables() -> list[Table]:
    """Return the tables that are copied, each after those that it refers to."""
    return [table for table in Base.metadata.sorted_tables if table.name not in _LEFT_OUT]


@contextmanager
def snapshot(engine: Engine) -> Iterator[Connection]:
    """Give a connection that sees the database as it is now, whatever others write meanwhile."""
    if engine.dialect.name == "sqlite":
        with engine.connect() as connection:
            connection.exec_driver_sql("BEGIN")  # the first statement that reads takes the snapshot
            try:
                yield connection
            finally:
                connection.rollback()
        return
    with engine.connect().execution_options(isolation_level="REPEATABLE READ", postgresql_readonly=True) as connection:
        take_time(connection)
        yield connection


def require_empty(connection: Connection) -> None:
    """Make sure that a migrated database holds nothing but the workspace that its migrations make.

    Raises
    ------
    CopyError
        Naming a table that has rows.
    """
    for table in tables():
        rows = select(func.count()).select_from(table)
        if table.name == Workspace.__tablename__:
            rows = rows.where(table.c.id != DEFAULT_WORKSPACE)
        count = connection.scalar(rows) or 0
        if count:
            raise CopyError(f"the database to be filled must be empty, got {count} rows in its table {table.name}")


def copy(source: Connection, target: Connection, *, tell: Tell = lambda _table, _rows: None) -> dict[str, Content]:
    """Copy every row into an empty database with the same tables, in the caller's transaction; return what was copied.

    Raises
    ------
    CopyError
        When a table does not hold afterwards what was read, or what is read is damaged.
    """
    take_time(target)
    require_empty(target)
    target.execute(delete(Workspace))
    copied = {}
    for table in tables():
        seen = _Digest(table)
        for batch in _rows(source, table):
            try:
                seen.take(batch)
                target.execute(insert(table), batch)
            except (StatementError, TypeError, ValueError) as error:
                if isinstance(error, DBAPIError) and not isinstance(error, (DataError, IntegrityError)):
                    raise  # of the target, and not of what it is to take
                why = getattr(error, "orig", error)
                raise CopyError(
                    f"rows of table {table.name} must be such as were written into it, got some that are damaged: {why}"
                ) from error
            tell(table.name, seen.rows)
        copied[table.name] = seen.content()
    arrived = content(target)
    for name, expected in copied.items():
        if arrived[name] != expected:
            raise CopyError(
                f"table {name} must arrive as it was sent: {expected.rows} rows with digest {expected.digest[:12]}, "
                f"got {arrived[name].rows} with {arrived[name].digest[:12]}"
            )
    return copied


def content(connection: Connection) -> dict[str, Content]:
    """Return what is in every table."""
    found = {}
    for table in tables():
        seen = _Digest(table)
        for batch in _rows(connection, table):
            seen.take(batch)
        found[table.name] = seen.content()
    return found


def requeue(session: Session, enqueue: Callable[[Session, str], None]) -> int:
    """Hand the jobs of a copy to the job engine that the old one had; return how many there are.

    Parameters
    ----------
    enqueue : callable
        Gives a job, by its id, its place in the queue.
    """
    carried = Job.status.in_((JobStatus.QUEUED, JobStatus.RUNNING)) & Job.ticket.is_not(None)
    session.execute(update(Job).where(carried).values(status=JobStatus.QUEUED, worker=None))
    identifiers = session.scalars(select(Job.id).where(carried).order_by(Job.created_at, Job.id)).all()
    for identifier in identifiers:
        enqueue(session, identifier)
    return len(identifiers)


def _rows(connection: Connection, table: Table) -> Iterator[list[dict[str, Any]]]:
    size = _BATCH_OF_CHUNKS if table.name == "blob_chunk" else _BATCH
    with connection.execution_options(yield_per=size).execute(select(table)) as found:
        try:
            for batch in found.mappings().partitions():
                yield [dict(row) for row in batch]
        except (TypeError, ValueError) as error:  # SQLite keeps instants and documents as texts
            raise CopyError(
                f"rows of table {table.name} must be such as were written into it, got some that are damaged: {error}"
            ) from error


class _Digest:
    """The rows of a table, counted and summed up."""

    def __init__(self, table: Table) -> None:
        self._names = [column.name for column in table.columns]
        self._sum = 0
        self.rows = 0

    def take(self, batch: list[dict[str, Any]]) -> None:
        for row in batch:
            text = json.dumps([row[name] for name in self._names], default=_plain, ensure_ascii=False)
            self._sum += int.from_bytes(hashlib.sha256(text.encode(errors="surrogatepass")).digest())
        self.rows += len(batch)

    def content(self) -> Content:
        return Content(rows=self.rows, digest=f"{self._sum % (1 << 256):064x}")


def _plain(value: Any) -> str:
    if isinstance(value, datetime):
        return value.isoformat()
    return hashlib.sha256(value).hexdigest()


def total(copied: Mapping[str, Content]) -> int:
    """Return how many rows there are in all."""
    return sum(part.rows for part in copied.values())
